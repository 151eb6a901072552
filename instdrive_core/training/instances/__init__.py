"""Instances of Gaussians, learned from masks: graph, votes, losses, names."""
