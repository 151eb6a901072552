"""Scene files: a module or room per format with its record, listed once in registry.py."""
