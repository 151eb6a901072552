"""What runs along the lane: lines, kerbs, marks, and the strips on which vehicles stand."""
