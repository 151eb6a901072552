"""Ground that a deletion uncovers: found, measured, and filled."""
