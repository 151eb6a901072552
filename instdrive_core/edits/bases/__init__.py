"""Base classes and checks that edits share."""
