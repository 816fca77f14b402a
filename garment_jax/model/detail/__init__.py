"""The detail enhancement (paper 3.4): networks, losses, train step."""
