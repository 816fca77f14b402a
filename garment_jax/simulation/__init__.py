"""Ground truth: cloth on a moving body, simulated with an optional engine (extra `sim`)."""
