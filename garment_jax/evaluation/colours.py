"""The pictures' colours, and the error scale in centimetres."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from garment_jax.body.trunk import trunk_share
from garment_jax.structs import RiggedBody

BODY = np.array([0.66, 0.66, 0.67])  # sRGB: a mannequin that leaves the eye to the cloth
BODYSUIT = np.array([0.33, 0.35, 0.39])
_HEM = (0.2, 0.4)  # shares of the trunk between which the bodysuit begins: it covers the seat
TRUTH = np.array([0.25, 0.45, 0.66])
PREDICTION = np.array([0.76, 0.38, 0.27])
_OTHERS = (  # several predictions in one picture
    PREDICTION,
    np.array([0.33, 0.58, 0.42]),
    np.array([0.52, 0.40, 0.66]),
    np.array([0.74, 0.58, 0.24]),
    np.array([0.28, 0.60, 0.64]),
    np.array([0.70, 0.42, 0.58]),
    np.array([0.48, 0.50, 0.54]),
)
PINS = np.array([0.85, 0.08, 0.10])  # what the body holds, on cloth in TRUTH's blue
INK, FAINT = (38, 42, 48), (116, 122, 130)  # text, 0 to 255

# Light to dark, so that it also reads in grey: no error is nearly white, the largest nearly black.
HEAT = np.array(
    [
        [0.93, 0.94, 0.96],
        [0.98, 0.86, 0.55],
        [0.97, 0.62, 0.27],
        [0.87, 0.31, 0.22],
        [0.62, 0.09, 0.28],
        [0.27, 0.04, 0.26],
    ]
)


def body_colours(body: RiggedBody) -> Float[np.ndarray, "b 3"]:
    """Return the sRGB colour of every vertex: a mannequin in a bodysuit, which ends at neck, arms and legs.

    One plain colour where the trunk is unknown (`body.trunk`).
    """
    share = trunk_share(body)
    if share is None:
        return np.tile(BODY, (len(body.vertices), 1))
    x = np.clip((share - _HEM[0]) / (_HEM[1] - _HEM[0]), 0.0, 1.0)
    covered = (x * x * (3 - 2 * x))[:, None]
    return (1 - covered) * BODY + covered * BODYSUIT


def garment_colours(kinds: Sequence[str], truth: int | None = None) -> list[np.ndarray]:
    """Return the sRGB colours `[3]` of the garments of clips of these `kinds`, shown together.

    The truth, clip number `truth`, has its own; without one the first clip has it, unless it is "predicted".
    """
    plain = truth if truth is not None else 0 if kinds and kinds[0] != "predicted" else None
    others = [i for i in range(len(kinds)) if i != plain]
    return [TRUTH if i == plain else _OTHERS[others.index(i) % len(_OTHERS)] for i in range(len(kinds))]


def linear(srgb: np.ndarray) -> np.ndarray:
    """Return sRGB colours, 0 to 1, in linear light, as files for renderers want them (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def heat(error_cm: np.ndarray, scale_cm: float) -> np.ndarray:
    """Return the colours `[..., 3]` of errors `[...]` on a scale from 0 to `scale_cm`, cut off there."""
    x = np.clip(error_cm / scale_cm, 0.0, 1.0) * (len(HEAT) - 1)
    low = np.minimum(x.astype(int), len(HEAT) - 2)
    part = (x - low)[..., None]
    return (1 - part) * HEAT[low] + part * HEAT[low + 1]


def round_scale(error_cm: np.ndarray) -> float:
    """Return a round number of cm (1, 2, 3, 4, 5, 6, 8 or 10 times a power of ten) for the scale's end.

    It covers 99 of 100 vertices: one stray vertex would leave all the others white. No error: 1 cm.
    """
    top = float(np.percentile(error_cm, 99)) if error_cm.size else 0.0
    if top <= 1e-6:
        return 1.0
    power = 10.0 ** np.floor(np.log10(top))
    return float(min(s * power for s in (1, 2, 3, 4, 5, 6, 8, 10) if s * power >= top * 0.999))
