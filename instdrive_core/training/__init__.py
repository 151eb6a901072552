"""From a clip to a scene with instances."""
