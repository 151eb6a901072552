"""Docked panels, dialogs and overlays: what the window shows, one file each.

`registry` lists the panels, `dialogs.registry` the dialogs and `overlays.registry` what is drawn over the picture.
"""
