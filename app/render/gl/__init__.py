"""The OpenGL renderer: its passes, and the textures that they read."""
