"""The pictures' colours, and the error scale in centimetres."""

import numpy as np

BODY = np.array([0.66, 0.66, 0.67])  # sRGB: a mannequin that leaves the eye to the cloth
TRUTH = np.array([0.25, 0.45, 0.66])
PREDICTION = np.array([0.76, 0.38, 0.27])
PINS = np.array([0.85, 0.08, 0.10])  # what the body holds, on cloth in TRUTH's blue
KINDS = {"predicted": PREDICTION}  # colours of one clip alone, by its file's kind; else TRUTH
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
