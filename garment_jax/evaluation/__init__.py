"""Metrics with their units, the evaluate command, and pictures."""
