"""Editing the way of a vehicle: its keys on the ground and in time, and its speed."""
