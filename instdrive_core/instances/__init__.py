"""Instance IDs as arrays: the static codebook, the bijective colour map, the table of instances, spatial components."""
