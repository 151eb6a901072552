"""Masks from cuboids and LiDAR classes that people annotated."""
