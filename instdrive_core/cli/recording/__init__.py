"""Commands that make sensor data of an edited drive."""
