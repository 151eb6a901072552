"""Instance masks of a trained scene, written for other programs."""
