"""Commands that open a window or look at this machine: one file each."""
