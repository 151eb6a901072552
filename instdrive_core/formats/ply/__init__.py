"""Everything that ends in .ply."""
