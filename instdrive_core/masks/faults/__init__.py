"""Faults put into perfect masks, so that a synthetic clip trains on what a segmenter would give it."""
