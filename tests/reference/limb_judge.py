"""How far a body in motion is from the person whose motion it was given: limbs, floor, path, hinges."""

from typing import NamedTuple

import numpy as np

from garment_jax.structs import Motion, RiggedBody
from tests.reference.person import SIDES, Performance

LIMBS = (("Arm", "ForeArm"), ("ForeArm", "Hand"), ("UpLeg", "Leg"), ("Leg", "Foot"))


class Verdict(NamedTuple):
    """The worst over frames, limbs and sides; angles in degrees, lengths in metres."""

    limb: float  # between limb bones' directions
    limb_name: str
    trunk: float  # between the directions from the hips to the neck
    heading: float  # between the lines through both hips, seen from above
    floor: float  # the lowest joint's height over its place, less what the person's lowest joint does
    path: float  # root less the person's times the legs' ratio, from the first frame on, over its length
    knee: float  # between the knees' hinge axes, thigh and shin
    elbow: float  # between the elbows' hinge axes of the upper arms


def plain_names(body: RiggedBody) -> list[str]:
    """A body's joint names without prefixes."""
    return [name.rpartition(":")[2] for name in body.joint_names]


def posed_joints(body: RiggedBody, motion: Motion) -> np.ndarray:
    """Return the joints' places `[t, j, 3]`, joint after joint."""
    x, R = body.joints.astype(float), motion.rotations.astype(float)
    places = np.zeros((len(motion.root), len(x), 3))
    for j, parent in enumerate(body.parents.tolist()):
        if parent < 0:
            places[:, j] = motion.root
        else:
            places[:, j] = places[:, parent] + R[:, parent] @ (x[j] - x[parent])
    return places


def judge(body: RiggedBody, motion: Motion, truth: Performance) -> Verdict:
    """Compare a body's motion with the truth, frame by frame (equal counts)."""
    names, places = plain_names(body), posed_joints(body, motion)
    assert len(places) == len(truth.positions), f"{len(places)} frames of {len(truth.positions)}"
    here = {name: places[:, j] for j, name in enumerate(names)}
    limbs = {
        f"{side}{a}": _angles(here[side + b] - here[side + a], truth.at(side + b) - truth.at(side + a)).max()
        for side in SIDES
        for a, b in LIMBS
    }
    worst = max(limbs, key=lambda name: limbs[name])
    trunk = _angles(here["Neck"] - here["Hips"], truth.at("Neck") - truth.at("Hips"))
    across = [(at("LeftUpLeg") - at("RightUpLeg")) * (1.0, 0.0, 1.0) for at in (here.__getitem__, truth.at)]
    return Verdict(
        float(limbs[worst]),
        worst,
        float(trunk.max()),
        float(_angles(*across).max()),
        _floor(body, places, truth),
        _path(body, motion, truth),
        _hinges(body, motion, truth, ("UpLeg", "Leg")),
        _hinges(body, motion, truth, ("Arm",)),
    )


def leg_ratio(body: RiggedBody, truth: Performance) -> float:
    """The body's legs, hip to ankle, over the person's."""
    names = plain_names(body)

    def here(name: str) -> np.ndarray:
        return body.joints[names.index(name)].astype(float)

    def there(name: str) -> np.ndarray:
        return truth.person.rest[truth.person.names.index(name)]

    def length(at) -> float:
        bones = [("UpLeg", "Leg"), ("Leg", "Foot")]
        return float(sum(np.linalg.norm(at(s + b) - at(s + a)) for s in SIDES for a, b in bones))

    return length(here) / length(there)


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.einsum("...i,...i->...", a, b)))


def _floor(body: RiggedBody, places: np.ndarray, truth: Performance) -> float:
    ends = [truth.person.names.index(side + name) for side in SIDES for name in ("Foot", "Toe")]
    lowest = truth.positions[:, ends, 1].min(axis=1)
    expected = body.joints[:, 1].min() + leg_ratio(body, truth) * (lowest - np.median(lowest))
    return float(np.abs(places[..., 1].min(axis=1) - expected).max())


def _path(body: RiggedBody, motion: Motion, truth: Performance) -> float:
    path = leg_ratio(body, truth) * (truth.positions[:, 0] - truth.positions[0, 0])
    length = np.linalg.norm(np.diff(path[:, [0, 2]], axis=0), axis=1).sum()
    missed = (motion.root - motion.root[0] - path)[:, [0, 2]]
    return float(np.linalg.norm(missed, axis=1).max() / length)


def _hinges(body: RiggedBody, motion: Motion, truth: Performance, joints: tuple[str, ...]) -> float:
    """A hinge's axis is across the two bones it joins; where they are in line, across and level."""
    names = plain_names(body)
    x, R = body.joints.astype(float), motion.rotations.astype(float)
    worst = 0.0
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        for name in joints:
            upper = "UpLeg" if "Leg" in name else "Arm"
            ends = {"UpLeg": ("UpLeg", "Leg"), "Leg": ("Leg", "Foot"), "Arm": ("Arm", "ForeArm")}[name]
            bone = x[names.index(side + ends[1])] - x[names.index(side + ends[0])]
            if upper == "UpLeg":
                rest, true = np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
            else:  # an elbow turns about -Y on the left side of a T-pose; the body's arms hang lower
                true = np.array([0.0, -sign, 0.0])
                hand = x[names.index(side + "Hand")] - x[names.index(side + "ForeArm")]
                rest = np.cross(bone, hand)
            rest = rest - (rest @ bone) / (bone @ bone) * bone
            there = truth.turn(side + name) @ true
            worst = max(worst, float(_angles(R[:, names.index(side + name)] @ rest, there).max()))
    return worst
