"""Videos and folders of photos without poses: what is chosen of them, and how their poses are found."""
