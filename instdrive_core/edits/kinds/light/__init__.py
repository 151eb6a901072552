"""Edits of the light that things stand in."""
