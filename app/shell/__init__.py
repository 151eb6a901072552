"""The window: display, layout, files dropped onto it, and what it reports to programs that drive it."""
