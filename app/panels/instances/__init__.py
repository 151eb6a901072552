"""The list of instances, its rows and their right-click menu."""
