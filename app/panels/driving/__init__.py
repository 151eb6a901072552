"""The way of a vehicle in time: the panel with its speed, and its keys on the timeline."""
