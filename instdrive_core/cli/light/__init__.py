"""Light on the command line."""
