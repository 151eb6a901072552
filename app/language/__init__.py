"""The language of the window: catalogues, the choice between them, and texts looked up in them."""
