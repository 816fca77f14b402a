"""A page that plays sequence files in a browser, with everything inside it."""
