"""Sessions that play themselves in the real window."""
