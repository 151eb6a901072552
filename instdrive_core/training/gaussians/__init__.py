"""The trainable scene: first points, parameters, optimisers, growth."""
