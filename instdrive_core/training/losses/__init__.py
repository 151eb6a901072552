"""Loss terms of a training step: one record each, listed in `registry`."""
