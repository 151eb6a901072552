"""The CPU renderer: pictures from the core's rasterizer, drawn on another thread."""
