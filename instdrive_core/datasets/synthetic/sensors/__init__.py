"""What records the synthetic street: ray tracing, cameras, LiDAR."""
