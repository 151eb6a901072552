"""Scenes in the making: the job that trains one in a process of its own, and measured runs side by side."""
