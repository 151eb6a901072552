"""mkkellogg's .ksplat, compression levels 0 to 2."""
