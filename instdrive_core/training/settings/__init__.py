"""What a run is told: config, schedule, events."""
