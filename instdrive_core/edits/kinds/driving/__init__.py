"""Edits that let vehicles drive other ways."""
