"""Training photos with their LiDAR depth and masks."""
