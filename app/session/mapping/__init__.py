"""The scene from straight above: the map's window onto the ground, its picture, and what is drawn over it."""
