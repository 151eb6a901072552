"""Depth from posed photos alone: which photos see the same, what they say of each pixel's depth, where they agree."""
