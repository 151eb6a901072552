"""Runnable measurements: `python -m benchmarks.NAME` prints one JSON line."""
