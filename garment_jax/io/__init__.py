"""Sequence files, packed clips, and the checks on clips at the border."""

from garment_jax.io.content_hash import body_hash, garment_hash, scene_hash
from garment_jax.io.sequence import Sequence, SequenceWriter, open_sequence

__all__ = ["Sequence", "SequenceWriter", "body_hash", "garment_hash", "open_sequence", "scene_hash"]
