"""The garment generative model (paper 3.2): networks, losses, train step."""
