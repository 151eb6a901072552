"""Where vehicles, and the recording car, are sent: the keys of their ways."""
