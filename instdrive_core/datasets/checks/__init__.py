"""Checks of drives before they train: what is missing, and what does not belong together."""
