"""Foreign file formats, one a file: arrays in and out, in the files' own units and axes."""
