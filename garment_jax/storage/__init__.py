"""Files that appear whole or not at all, and folders that one process at a time works in."""
