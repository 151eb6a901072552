"""Settings of a run, its schedule, and the events that it reports."""
