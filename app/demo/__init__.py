"""Scripted sessions in the real window."""
