"""Raised legs put into a motion: kicks and lifts to the front, to the side and backwards.

Captured dances hold few, each in one direction, and a skirt that a leg lifts does what it does nowhere else.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.structs import Motion, RiggedBody

SIDES = {"Left": 1.0, "Right": -1.0}  # outward is this way along the canonical X, with the body facing +Z
JOINTS = "LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg"
TOWARDS = 0.0, 90.0, 180.0  # degrees from the front over the leg's own side to the back
HIGHEST = 120.0, 100.0, 50.0  # degrees from hanging that a leg is raised there at most
LOWEST = 0.3  # part of the highest that it is raised at least
RATE = 200.0, 700.0  # degrees per second at its fastest, on the way up; two kicks that fall together add up
FALL = 0.8, 1.6  # of the way up's time that the way down takes
HOLD = 0.6  # seconds that it stays up at most
KNEE = 100.0  # degrees that the knee is bent on the way at most
BENT = 0.4  # part of the kicks that stay bent
LEAN = 0.25  # part of the leg's angle that the pelvis leans along at most


def kicked(motion: Motion, body: RiggedBody, in_ten_seconds: float, rng: np.random.Generator) -> Motion:
    """Return the motion with raised legs at random times, `in_ten_seconds` of them on average.

    At the top a thigh points where the kick goes, from the pelvis, whatever it did in the motion; the pelvis
    leans along, and the other leg stays. Raises `ValueError` for a body without legs of these names.
    """
    names = list(body.joint_names)
    missing = [joint for joint in JOINTS if joint not in names]
    if missing:
        raise ValueError(f"kicks need the joints {', '.join(JOINTS)}, and the body has no {missing[0]}.")
    parents = np.maximum(body.parents, 0)
    R = motion.rotations.astype(np.float64)
    local = np.swapaxes(R[:, parents], -1, -2) @ R
    local[:, 0] = R[:, 0]
    time = np.arange(len(R)) / motion.fps
    for _ in range(rng.poisson(in_ten_seconds * time[-1] / 10.0)):
        _kick(local, names, time, rng)
    out = local.copy()
    for j in range(1, len(parents)):  # parents come before their children
        out[:, j] = out[:, parents[j]] @ local[:, j]
    return motion._replace(rotations=out.astype(motion.rotations.dtype))


def _kick(local: np.ndarray, names: list[str], time: np.ndarray, rng: np.random.Generator) -> None:
    """Put one raised leg into the joints' rotations against their parents, in place."""
    side, other = rng.permutation(list(SIDES)).tolist()
    towards = np.degrees(rng.triangular(0.0, 0.0, np.pi))  # most kicks go to the front
    highest = np.interp(towards, TOWARDS, HIGHEST)
    angle = np.radians(highest * rng.uniform(LOWEST, 1.0))
    up = np.pi / 2 * angle / np.radians(rng.uniform(*RATE))
    hold, down = rng.uniform(0.0, HOLD), up * rng.uniform(*FALL)
    begun = rng.uniform(-up, time[-1])
    raised = _half(time - begun, up) - _half(time - begun - up - hold, down)
    bend = np.radians(rng.uniform(0.0, KNEE)) * (raised if rng.random() < BENT else np.sin(np.pi * raised))
    lean = rng.uniform(0.0, LEAN) * angle * raised
    out = SIDES[side] * np.sin(np.radians(towards)), np.cos(np.radians(towards))
    axis = np.array([-out[1], 0.0, out[0]])  # turns what hangs towards where the kick goes
    thigh, knee, support = (names.index(joint) for joint in (f"{side}UpLeg", f"{side}Leg", f"{other}UpLeg"))
    local[:, 0] = local[:, 0] @ _about(axis, lean)
    local[:, support] = _about(axis, -lean) @ local[:, support]
    local[:, thigh] = _about(axis, angle * raised - lean) @ _less(local[:, thigh], raised)
    local[:, knee] = _less(local[:, knee], raised) @ _about(np.array([1.0, 0.0, 0.0]), bend)


def _half(since: np.ndarray, lasts: float) -> np.ndarray:
    """Return a smooth rise from 0 to 1 in `lasts` seconds."""
    return 0.5 * (1.0 - np.cos(np.pi * np.clip(since / lasts, 0.0, 1.0)))


def _about(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(angle[:, None] * axis).as_matrix()


def _less(R: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return rotations `[t, 3, 3]` less `part` of their angles."""
    return Rotation.from_rotvec(Rotation.from_matrix(R).as_rotvec() * (1.0 - part)[:, None]).as_matrix()
