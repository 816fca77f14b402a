"""The tests; a package, so that no other installed `tests` can be imported in its place."""
