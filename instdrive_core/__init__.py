"""InstDrive's core: driving clips to Gaussians with instance IDs, and edits on them. No window, no OpenGL."""
