"""Scene files: one file per format, registered once in registry.py."""
