"""Dynamic garments learnt from simulation: a loose skirt that follows a dance, in JAX."""

__version__ = "0.1.0"
