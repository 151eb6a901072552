"""Edits of the shape of things."""
