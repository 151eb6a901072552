"""The edited drive for a simulator: cameras and LiDAR at any pose, over gRPC."""
