"""Logs of Argoverse 2's sensor data set."""
