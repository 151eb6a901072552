"""The editor without a window: the open document, the view of it, and the controllers that change both."""
