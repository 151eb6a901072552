"""What helps an artist to look, to measure and to cut out: screenshots, kept views, the ruler and the box."""
