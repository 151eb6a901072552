"""NVIDIA NuRec: tracks of its reconstructions, and edits of its actors."""
