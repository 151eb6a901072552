"""The picture from the core's CPU rasterizer, drawn on a thread of its own."""
