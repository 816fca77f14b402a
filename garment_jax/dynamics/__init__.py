"""Local dynamics: a learned simulator that moves every patch of cloth by what is near it (not in the paper)."""
