"""Numbers and their nouns in texts for the user."""

from __future__ import annotations


def format_count(count: int, noun: str, plural: str = "") -> str:
    """Write a count with its noun: ``1 splat``, ``2,000 splats``. Give `plural` where it is not the noun with an s."""
    return f"{count:,} {noun if count == 1 else plural or noun + 's'}"
