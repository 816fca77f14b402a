"""Clips made ready for training and animation: statistics, windows, lanes, batches."""
