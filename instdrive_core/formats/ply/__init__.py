"""The .ply formats: INRIA's layout, its twin for SIBR viewers, and the packed one."""
