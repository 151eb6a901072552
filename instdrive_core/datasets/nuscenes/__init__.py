"""Scenes of nuScenes, and of TIER IV's T4 format, which has the same tables."""
