"""The open document and its files: opening, recovering and saving, recent files and the autosave."""
