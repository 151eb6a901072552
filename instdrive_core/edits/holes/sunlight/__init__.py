"""Where the sun stands, and which ground lies in the shade of what stands around it."""
