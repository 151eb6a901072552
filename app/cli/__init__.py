"""Commands that open a window or examine this machine: one file each."""
