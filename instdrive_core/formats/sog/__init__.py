"""PlayCanvas's SOG, as an archive, a folder, or levels of detail."""
