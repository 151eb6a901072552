"""Drives of KITTI: raw recordings, the tracking benchmark, and KITTI-360."""
