"""Per-frame instance masks: one file per source."""
