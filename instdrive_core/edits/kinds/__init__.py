"""One file per edit."""
