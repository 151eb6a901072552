"""What moves in photos: no LiDAR, cuboids or classes are looked at."""
