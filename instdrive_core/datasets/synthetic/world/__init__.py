"""What the synthetic street is made of, and the light on it."""
