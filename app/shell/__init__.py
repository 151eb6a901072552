"""The window: display, layout, dropped files, and reports to programs that drive it."""
