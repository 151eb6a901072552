"""Label repairs whose outcome is kept row by row."""
