"""Label pictures: points and borders become regions of a photo."""
