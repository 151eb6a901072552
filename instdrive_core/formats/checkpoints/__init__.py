"""Scenes in what other trainers save: checkpoints of torch, read without torch, and INRIA's training folders."""
