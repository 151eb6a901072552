"""A scene as one .html that shows it in any browser, with the names of its instances."""
