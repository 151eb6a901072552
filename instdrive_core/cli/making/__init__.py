"""Commands that run a whole job: making a scene, and training one on."""
