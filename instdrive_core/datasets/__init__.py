"""Driving clips: one file per data set behind one `Clip`."""
