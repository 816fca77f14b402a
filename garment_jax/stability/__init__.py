"""Stiff and extreme cases: what holds, what is reported as not holding, and what does not."""
