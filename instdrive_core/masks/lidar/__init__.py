"""Masks from bare LiDAR."""
