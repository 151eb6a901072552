"""Which Gaussians belong together: graph, votes, losses, names."""
