"""Drives too long for one training: cut along the road, trained piece by piece, joined into one scene."""
