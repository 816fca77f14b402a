"""Animate a garment: one frame, a scan over frames, chunks streamed to disk, whole models on disk."""
