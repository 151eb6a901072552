"""The selected instances in numbers: facts, colour, adjustments, placement."""
