"""Moving objects found in LiDAR sweeps without labels."""
