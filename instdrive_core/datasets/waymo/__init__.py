"""Segments of the Waymo Open Dataset as parquet tables (version 2)."""
