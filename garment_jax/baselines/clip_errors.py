"""A baseline's errors on the clips kept back."""

from collections.abc import Sequence

import numpy as np

from garment_jax.dataset.prepared import PreparedClip


def clip_errors(clips: Sequence[PreparedClip], V: Sequence[np.ndarray]) -> dict[str, float]:
    """Return the RMSE of `V` `[t, n, 3]` on each of `clips` and their mean, cm, by name; root frames."""
    square = [1e4 * np.square(v - c.V).sum(axis=-1).mean() for v, c in zip(V, clips, strict=True)]
    errors = {f"{c.name}_rmse_cm": float(np.sqrt(s)) for c, s in zip(clips, square, strict=True)}
    return {"rmse_cm": float(np.mean(list(errors.values()))), **errors}
