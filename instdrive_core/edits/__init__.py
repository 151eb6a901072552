"""Undoable changes to a scene."""
