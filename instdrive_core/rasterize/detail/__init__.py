"""Levels of detail: what is small on the screen is drawn as a few merged splats.

Drafts of large scenes are drawn from them while the camera moves; sharp pictures, clicks and edits use the real splats.
"""
