"""Training on from a finished scene: its rows keep their places and identities, what grows inherits them."""
