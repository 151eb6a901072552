"""Shape: what was never seen of a thing."""
