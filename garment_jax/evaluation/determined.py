"""What no method can know: frames in which a second simulation of the same motion already hangs elsewhere.

Not in the paper. Cloth is chaotic where folds swing over: two simulations that begun alike to the eye part by
centimetres. Until they do, a frame is determined and an error is an error; afterwards an error is held
against the distance of the two.
"""

import numpy as np

PARTED_CM = 0.5  # RMSE of the two simulations from which on frames are not determined


def determined_frames(again_cm: np.ndarray) -> int:
    """Return how many frames come before the first in which `again_cm` `[t]` passes `PARTED_CM`."""
    parted = np.flatnonzero(again_cm > PARTED_CM)
    return int(parted[0]) if len(parted) else len(again_cm)


def against_again(error_cm: np.ndarray, again_cm: np.ndarray) -> dict[str, float | None]:
    """Return a clip's error on determined frames, and on the others as a multiple of the second run's.

    `error_cm`, `again_cm` `[t]`: RMSE a frame of the prediction and of the second simulation, against the
    first. None where there is no such frame.
    """
    count = determined_frames(again_cm)
    rest = root_mean_square(again_cm[count:])
    return {
        "again_rmse_cm": root_mean_square(again_cm),
        "determined_percent": 100.0 * count / len(again_cm),
        "determined_rmse_cm": root_mean_square(error_cm[:count]) if count else None,
        "parted_rmse_cm": root_mean_square(error_cm[count:]) if count < len(error_cm) else None,
        "parted_error_ratio": root_mean_square(error_cm[count:]) / rest if rest > 0 else None,
    }


def root_mean_square(values: np.ndarray) -> float:
    """Return the root of the mean square, 0 of nothing."""
    return float(np.sqrt((values**2).mean())) if len(values) else 0.0
