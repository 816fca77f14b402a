"""Lengths and axes of foreign files brought to metres, Y up; what nobody says is not guessed in silence."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.up_axis import TO_Y

UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254, "inches": 0.0254, "ft": 0.3048}
_AXES = ("Y", "Z")
_METRES = (0.15, 2.5)  # extents of garments and bodies that wear them, in metres


class Unit(NamedTuple):
    """Metres per unit of length, and what the user is to know about how that was settled."""

    metres: float
    note: str = ""


def metres_per_unit(unit: float | str, option: str = "--unit") -> float:
    """Return a unit as metres: a number, or one of `UNITS`; `ValueError`, with the option, otherwise."""
    if isinstance(unit, str) and unit.lower() in UNITS:
        return UNITS[unit.lower()]
    try:
        metres = float(unit)
    except ValueError:
        metres = 0.0
    if not (np.isfinite(metres) and metres > 0):
        raise ValueError(f"{option} {unit} is no unit; give one of {', '.join(UNITS)}, or metres per unit.")
    return metres


def turn_to_y_up(up: str, option: str = "--up") -> np.ndarray:
    """Return the rotation `[3, 3]` of column vectors from a world with that axis up to Y up."""
    if up.upper() not in _AXES:
        raise ValueError(f"{option} {up} is no up axis that is known; give {' or '.join(_AXES)}.")
    return TO_Y[up.upper()]


def to_metres_y_up(points: np.ndarray, unit: float | str, up: str) -> np.ndarray:
    """Return `points` `[..., 3]` in metres, Y up, in their own type; `ValueError` for a wrong unit or axis.

    With Z up, (x, y, z) becomes (x, z, -y).
    """
    with np.errstate(over="ignore"):  # what a type cannot hold is infinite, and refused as such
        turned = points * np.asarray(metres_per_unit(unit), points.dtype)
    if turn_to_y_up(up) is TO_Y["Z"]:
        turned = np.stack([turned[..., 0], turned[..., 2], -turned[..., 1]], axis=-1)
    return turned


def settle_unit(
    stated: float | None, given: float | str | None, extent: float, what: str, option: str = "--unit"
) -> Unit:
    """Return the unit of `what`, a thing `extent` units large: the user's, else the file's, else metres.

    Metres are taken only for what is then as large as a garment or a body, and that is said in the note.
    Raises `ValueError`, with the size, where neither says it.
    """
    if given is not None:
        return Unit(metres_per_unit(given, option))
    if stated is not None:
        return Unit(stated)
    if _METRES[0] <= extent <= _METRES[1]:
        return Unit(
            1.0, f"{what} is {extent:.3g} units large and its file does not say which: taken for metres"
        )
    raise ValueError(
        f"{what} is {extent:.4g} units large, and its file does not say which; give {option} cm, m, mm or in."
    )
