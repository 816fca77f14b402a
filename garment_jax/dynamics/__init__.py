"""Local dynamics: a learned simulator; every patch of cloth moves by what is near it (not in the paper)."""
