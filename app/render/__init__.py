"""The editor's OpenGL passes."""
