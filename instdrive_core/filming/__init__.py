"""Films: a camera's path between keys, its file, and its frames as pictures or a video."""
