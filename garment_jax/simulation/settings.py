"""What the cloth is made of and how finely it is simulated."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields

from garment_jax.config.key import key, metadata

BEFORE = ("settle", "blend", "hold", "turn_in")  # settings of the frames before a clip's first
_SWITCH = {"on": True, "true": True, "off": False, "false": False}


@dataclass(frozen=True)
class ClothSettings:
    """Settings of Newton's Style3D solver; the defaults gave a plausible loose skirt.

    They were measured at 0.2 kg/m2 with 2,800 vertices. Fewer substeps or iterations penetrate, look
    rubbery, and after a fast turn leave the cloth bunched at the waist for good; so does a softer bend
    without self-collision. Raises `ValueError` for a number that cannot be simulated.
    """

    fps: float = key(30.0, "frames per second of the motion and of the result", "positive")
    substeps: int = key(
        10, "solver steps per frame; the engine takes 0.2 % of the speed at each of them", "positive"
    )
    iterations: int = key(10, "non-linear iterations per substep", "positive")
    linear_iterations: int = key(20, "conjugate-gradient iterations per non-linear one", "positive")
    stretch: float = key(1e3, "N/m, along both axes of the pattern", "positive")
    shear: float = key(1e2, "N/m")
    bend: float = key(3e-4, "N m")
    bend_bias: float = key(1.0, "of folds at 45 degrees to the threads, in parts of `bend`")
    density: float = key(0.2, "kg/m2", "positive")
    gravity: float = key(9.81, "m/s2, downwards")
    contact_stiffness: float = key(1e3, "N/m per vertex", "positive")
    contact_damping: float = key(1e-5, "N s/m per vertex")
    friction: float = key(0.3, "Coulomb's coefficient, cloth on body")
    particle_radius: float = key(5e-3, "m, distance that vertices keep from the body", "positive")
    contact_gap: float = key(20e-3, "m beyond the radius within which contacts are looked for", "positive")
    self_collision: bool = key(False, "nearly doubles the time")
    self_collision_radius: float = key(2.5e-3, "m; 2 mm for 9,000 vertices, 3 mm for 2,000", "positive")
    air: bool = key(True, "drag across each face's normal")
    air_density: float = key(1.2, "kg/m3")
    drag: float = key(1.2, "drag coefficient of a face across its normal")
    settle: int = key(45, "frames in the canonical pose, once per garment and body")
    blend: int = key(36, "frames from there to the clip's first pose")
    hold: int = key(12, "frames in the first pose, before the clip's first frame")
    turn_in: bool = key(False, "the blend turns the body from +Z, too, and begins at the canonical height")

    def __post_init__(self) -> None:
        for field in fields(self):
            value, free = getattr(self, field.name), metadata(field).check == "not negative"
            if not (math.isfinite(value) and (value >= 0 if free else value > 0)) and not _switch(value):
                bound = "be 0 or more" if free else "be more than 0"
                raise ValueError(f"{field.name}={value} must {bound}; the default is {field.default}.")

    @property
    def substep(self) -> float:
        """Seconds of one solver step."""
        return 1.0 / (self.fps * self.substeps)

    @property
    def reach(self) -> float:
        """Metres from the body within which contacts are looked for."""
        return self.particle_radius + self.contact_gap

    def describe(self) -> str:
        """Return every setting in one line, for a file's attributes."""
        return ", ".join(f"{field.name} {_short(getattr(self, field.name))}" for field in fields(self))


def _switch(value: float) -> bool:
    return isinstance(value, bool)


def _short(value: float) -> str:
    return ("on" if value else "off") if _switch(value) else f"{value:g}"


def parse_cloth(pairs: Iterable[str], option: str) -> ClothSettings:
    """Return the settings with `KEY=VALUE` pairs put in, which `option` gave.

    Raises `ValueError` for an unknown key or a wrong value.
    """
    known = {field.name: field for field in fields(ClothSettings)}
    values = {}
    for pair in pairs:
        key, _, text = pair.partition("=")
        if key not in known:
            raise ValueError(f"{option} {pair!r}: there is no setting {key!r}; choose of {', '.join(known)}.")
        values[key] = _parse(f"{option} {pair!r}", pair, text, type(known[key].default))
    return ClothSettings(**values)


def _parse(given: str, pair: str, text: str, kind: type) -> float | bool:
    if kind is bool:
        if text not in _SWITCH:
            raise ValueError(f"{given} is a switch; write on or off.")
        return _SWITCH[text]
    try:
        return kind(text)
    except ValueError as error:
        number = "a whole number" if kind is int else "a number"
        raise ValueError(f"{given} needs {number}, such as {pair.partition('=')[0]}=10.") from error
