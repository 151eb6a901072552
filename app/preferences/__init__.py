"""How the editor looks and answers: themes, instance colours, keys, and what the user has chosen of them."""
