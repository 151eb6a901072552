"""InstDrive's desktop editor."""
