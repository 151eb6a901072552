"""The scene as numpy data with invariants: Gaussians, cameras, tracks, sky, edit state. No files, no drawing."""
