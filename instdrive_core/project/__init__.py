"""Keeping edits: project files that replay them, and a journal from which they are recovered after a crash."""
