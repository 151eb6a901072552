"""Objects of a finished scene from photos and their masks: where the scene lies among the photos, and what is one."""
