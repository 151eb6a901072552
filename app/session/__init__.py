"""The editor without a window: one document, the view of it, and what each action does to them."""
