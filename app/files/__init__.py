"""Files as the editor names, lists and finds them."""
