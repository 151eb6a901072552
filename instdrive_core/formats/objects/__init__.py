"""Boxes, hulls and poses of instances, for other programs."""
