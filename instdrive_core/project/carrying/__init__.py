"""Carrying edits over to a scene that was trained on: the same edits, for rows that are the same or grew from them."""
