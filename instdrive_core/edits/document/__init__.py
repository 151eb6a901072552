"""The scene being edited: its state, its history, and which rows belong to what."""
