"""The native scene folder."""
