"""Commands that run a whole job: making a scene, training one on, finding its objects."""
