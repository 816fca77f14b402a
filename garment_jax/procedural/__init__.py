"""A body, its motions and its garments made in code: the default that needs no asset files."""
