"""A procedural street, written in PandaSet's layout."""
