"""Compiled loops: projection, binning, blending, and the gradients of each."""
