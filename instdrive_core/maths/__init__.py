"""Pure functions on arrays: rotations, spherical harmonics, activations, sorting, random streams."""
