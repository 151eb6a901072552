"""Bytes on disk: whole or absent, bounded, untrusted. Knows no scene."""
