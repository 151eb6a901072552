"""Other methods of learning instances, on the same geometry, masks and blending weights as ours."""
