"""The systems that the paper compares with, all behind one interface (`method.py`), by name in `METHODS`."""

from garment_jax.baselines.method import Method, Runner, Stream
from garment_jax.baselines.methods import METHODS

__all__ = ["METHODS", "Method", "Runner", "Stream"]
