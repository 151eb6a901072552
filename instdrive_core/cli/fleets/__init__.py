"""Commands on many clips."""
