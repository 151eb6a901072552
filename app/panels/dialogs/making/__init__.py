"""Dialogs that begin a job in a process of its own, and ask about it."""
