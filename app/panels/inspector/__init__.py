"""The inspector: facts about the selected instances, and their colour, adjustments and placement."""
