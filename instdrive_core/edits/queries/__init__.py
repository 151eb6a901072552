"""Questions about a document that change nothing."""
