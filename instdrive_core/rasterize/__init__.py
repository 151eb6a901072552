"""Gaussians × camera → per-pixel channels, on the CPU."""
