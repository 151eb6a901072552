"""OpenGL passes and the arrays that they read."""
