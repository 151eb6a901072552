"""Light: shadows of what is put somewhere."""
