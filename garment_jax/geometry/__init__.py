"""Geometry that knows nothing of garments or bodies."""
