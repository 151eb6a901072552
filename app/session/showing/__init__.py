"""What shows the scene to others: the camera's path between keys."""
