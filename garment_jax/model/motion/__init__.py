"""The dynamic motion encoder (paper 3.3): networks, losses, train step."""
