"""Which axis of a motion file's world is up: what the posed skeleton shows, against what the format says."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from garment_jax.body.local_axes import upright_axis

_SURE = (
    0.75  # mean alignment of trunk and legs with an axis, from which on somebody stands, or lies, along it
)
_STANDING = (0.5, 1.5)  # root's height over 0, parts of the legs' length, of somebody who stands
_GROUND = 0.35  # and the lowest joint's distance from 0
_TRAVEL = 0.5  # parts of the legs' length; who moves so far along an axis does not stand on it
# takes the axis to +Y; what Z up has in front, -Y as in Blender, is at +Z then
TO_Y = {
    "Y": np.eye(3),
    "Z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
    "-Y": np.diag([1.0, -1.0, -1.0]),
    "-Z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "X": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "-X": np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
}


class UpAxis(NamedTuple):
    """An axis and what the user is to know about how it was found."""

    axis: str  # "Y", "Z", "-Y" ...
    note: str = ""


def known_axis(up: str) -> str:
    """Return the axis that a user says is up, as `TO_Y` has it; `ValueError` for what is none."""
    if up.upper() not in TO_Y:
        raise ValueError(f"the up axis {up!r} is unknown; give X, Y or Z.")
    return up.upper()


def settle_up(
    positions: np.ndarray,
    at: Mapping[str, int],
    *,
    usual: str,
    said: str | None = None,
    rest_up: str | None = None,
) -> UpAxis:
    """Return the axis that is up in a world of joint `positions` `[t, j, 3]`, any unit.

    `at`: role -> joint (`local_axes.NEEDED`). `usual` is the format's axis, `said` the user's, `rest_up` the
    one along which the file's rest pose stands. The skeleton's posture counts where the axis is also the one
    that it stands on: the rest pose has it too, or the feet stay at 0 and the hips at the legs' height, or
    the clip travels along `usual` and not along it; else somebody lies there. What the user says counts
    against one such sign, with a note. Raises `ValueError` where the user says another axis than the motion
    shows beyond doubt: it travels across that axis, or the rest pose and the floor both agree with it.
    """
    shown, sure = upright_axis(positions, at)
    expected = said or usual
    if sure < _SURE or shown == expected:
        return UpAxis(expected)
    travels = _travels(positions, at, expected, shown)
    signs = (rest_up == shown) + _stands(positions, at, shown)
    if not signs and not travels:
        lying = f"the body lies along {shown} with {expected} up"
        return UpAxis(expected, f"{lying}, which is as the format has it (--motion-up says otherwise)")
    if said is None:
        return UpAxis(shown, f"the motion stands along {shown}, not along {usual}: taken for {shown} up")
    remedy = f"give --motion-up {shown}" if shown in ("Y", "Z") else "leave --motion-up out"
    if travels or signs == 2:
        raise ValueError(f"the motion stands along {shown}, not along {said}; {remedy}.")
    return UpAxis(
        said, f"the body lies along {shown} with {said} up, as you say; if it should stand, {remedy}"
    )


def axis_name(direction: np.ndarray) -> str:
    """Return the name of the axis nearest to `direction` `[3]`."""
    k = int(np.abs(direction).argmax())
    return ("" if direction[k] > 0 else "-") + "XYZ"[k]


def _along(positions: np.ndarray, axis: str) -> np.ndarray:
    return (-1.0 if axis[0] == "-" else 1.0) * positions[..., "XYZ".index(axis[-1])]


def leg_length(positions: np.ndarray, at: Mapping[str, int]) -> float:
    """Return the length of both legs from hip to ankle, the median over frames; file units."""
    bones = [
        (f"{s}{a}", f"{s}{b}") for s in ("Left", "Right") for a, b in (("UpLeg", "Leg"), ("Leg", "Foot"))
    ]
    lengths = [np.linalg.norm(positions[:, at[b]] - positions[:, at[a]], axis=1) for a, b in bones]
    return float(sum(np.median(length) for length in lengths))


def _stands(positions: np.ndarray, at: Mapping[str, int], axis: str) -> bool:
    leg, height = leg_length(positions, at) / 2, _along(positions, axis)
    hips, lowest = np.median(height[:, at["Hips"]]), np.median(_lowest(positions, at, axis))
    return bool(_STANDING[0] * leg < hips < _STANDING[1] * leg and abs(lowest) < _GROUND * leg)


def _travels(positions: np.ndarray, at: Mapping[str, int], along: str, axis: str) -> bool:
    leg = leg_length(positions, at) / 2
    spread, other = (float(np.ptp(_lowest(positions, at, a))) for a in (along, axis))
    return spread > _TRAVEL * leg and other < 0.5 * spread


def _lowest(positions: np.ndarray, at: Mapping[str, int], axis: str) -> np.ndarray:
    feet = positions[:, [at["LeftFoot"], at["RightFoot"], at["Hips"]]]
    return _along(feet, axis).min(axis=1)
