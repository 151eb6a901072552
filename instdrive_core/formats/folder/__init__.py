"""The program's own scene folder."""
