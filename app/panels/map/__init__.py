"""The panel that shows the scene from straight above: its canvas, what is drawn on it, and what can be dragged there.

What can be dragged is a `MapLayer`: a new one is a file and a line in `panel`.
"""
