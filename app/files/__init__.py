"""Naming, listing and finding files for the user."""
