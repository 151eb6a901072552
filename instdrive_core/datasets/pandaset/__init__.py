"""PandaSet's sequences."""
