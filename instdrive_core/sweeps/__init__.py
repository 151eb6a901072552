"""LiDAR sweeps of a scene: rays of a sensor cast into the Gaussians."""
