"""What deletions leave: residue and holes, and the fill of several holes as one step."""
