"""A sequence file becomes what other programs open; a model becomes a graph that they run."""
