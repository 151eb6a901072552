"""Docked panels: one file each."""
