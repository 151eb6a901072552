"""The figures, each computed from arrays."""
