"""How a body's joints are turned against those of any other skeleton, whatever its rest pose.

A body's joint takes its source's world rotation times a constant, R = R_source C. A rigid bone has one
direction in its joint's own axes, in every frame; so a C that takes the body's bone to that direction makes
the posed limbs point where the source's point, without any rest pose. What is left is the twist about it:
knees and elbows turn about one axis, thigh x shin, whose mean over the frames (bent ones weigh most) is taken
to the body's. Hips, spine and head take their left from the line through both hips or shoulders and their up
from the hips to the neck, the mean over the frames; if the joint's own axes are within `SNAP` of these, which
is so for all capture programs, they count, and leaning forward is leaning.

A skeleton that stands in its rest pose, on whichever axis, needs none of that: its rest is the body's, but
for limbs, which turn along the shortest arc.
"""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.geometry.rigid_fit import nearest_rotations
from garment_jax.structs import RiggedBody

SNAP = np.radians(20.0)  # a trunk's joint that leans less has its own axes
_SAME = np.radians(0.1)
_BENT = np.sin(np.radians(15.0))  # a hinge that is never bent more does not show its axis
_ALONG = 0.7  # cosine by which a standing skeleton's legs point down
_SIDES = ("Left", "Right")
_CHAIN = {"Arm": "ForeArm", "ForeArm": "Hand", "UpLeg": "Leg", "Leg": "Foot"}
_SIGNED_AXES = Rotation.create_group("O").as_matrix()  # 24: every joint's axes along the world's
NEEDED = ("Hips", "Neck", *(f"{s}{n}" for s in _SIDES for n in ("Arm", "ForeArm", "UpLeg", "Leg", "Foot")))


def alignments(
    rotations: np.ndarray,
    positions: np.ndarray,
    rest: np.ndarray,
    sources: np.ndarray,
    body: RiggedBody,
    roles: Mapping[str, int],
) -> np.ndarray:
    """Return C of each body joint `[j, 3, 3]` (module docstring).

    `rotations` `[t, s, 3, 3]`, `positions` `[t, s, 3]`: the source's joints in the world; `rest` `[s, 3]`:
    where they stand when every rotation is the identity. `sources` `[j]`: the body joints' source joints, -1
    for none (they have their parent's C). `roles`: the body's joints by what they are (`NEEDED`, and
    Spine..., Head, Shoulder, Hand, ToeBase where it has them). Up need not be Y.
    """
    at = {role: int(sources[j]) for role, j in roles.items() if sources[j] >= 0}
    standing = standing_axes(rest, at)
    role_of = {j: role for role, j in roles.items()}
    hinges = _hinges(positions, at)
    C = np.tile(np.eye(3), (len(sources), 1, 1))
    for j, source in enumerate(sources):
        above = _mapped_parent(j, sources, body)
        role = role_of.get(j, "")
        side = next((s for s in _SIDES if role.startswith(s)), "")
        if source < 0:
            C[j] = C[body.parents[j]] if j else np.eye(3)
        elif side and role.removeprefix(side) in _CHAIN and side + _CHAIN[role.removeprefix(side)] in at:
            end = side + _CHAIN[role.removeprefix(side)]
            bone = (body.joints[roles[end]] - body.joints[j]).astype(np.float64)
            along = _local_mean(rotations[:, source], positions[:, at[end]] - positions[:, source])
            if standing is not None:
                turn = shortest_turn(standing @ bone, along)
                same = _angle(turn, np.eye(3)) < _SAME  # float32 rotations: the rest poses are one
                C[j] = standing if same else turn @ standing
                continue
            across = _local_mean(rotations[:, source], hinges[role])
            C[j] = _frame(along, across) @ _frame(bone, _body_hinge(role, side, body, roles)).T
        elif standing is not None:
            C[j] = standing if j == 0 or role.endswith("Foot") else C[above]
        elif role and not side:
            C[j] = _trunk(rotations[:, source], positions, at, role)
        elif role == f"{side}Foot" and f"{side}ToeBase" in at:
            toe = (body.joints[roles[f"{side}ToeBase"]] - body.joints[j]).astype(np.float64)
            along = _local_mean(
                rotations[:, source], positions[:, at[f"{side}ToeBase"]] - positions[:, source]
            )
            across = _local_mean(rotations[:, source], (rotations[:, sources[above]] @ C[above])[..., 0])
            C[j] = _frame(along, across) @ _frame(toe, np.array([1.0, 0.0, 0.0])).T
        elif sources[above] < 0:
            C[j] = C[above]
        else:
            C[j] = _as_above(rotations, int(source), int(sources[above]), C[above])
            C[j] = _snapped(C[j]) if role.endswith("Shoulder") else C[j]
    return C


def standing_axes(rest: np.ndarray, at: Mapping[str, int]) -> np.ndarray | None:
    """Return left, up and forward of a rest pose that stands, as columns `[3, 3]`; None if it does not.

    Columns are along the world's axes. A rest pose stands if hips, neck and shoulders are within 30 degrees
    of such axes, the legs point down and no arm points to the other side.
    """
    up = rest[at["Neck"]] - rest[at["Hips"]]
    left = rest[at["LeftUpLeg"]] - rest[at["RightUpLeg"]]
    if min(np.linalg.norm(up), np.linalg.norm(left), np.linalg.norm(np.cross(up, left))) < 1e-9:
        return None
    axes = _square(left, up)
    near = _nearest(axes)
    if _angle(axes, near) > np.radians(30.0):
        return None
    for side, sign in zip(_SIDES, (1.0, -1.0), strict=True):
        for a, b, way in (("UpLeg", "Leg", -near[:, 1]), ("Leg", "Foot", -near[:, 1])):
            if _unit(rest[at[side + b]] - rest[at[side + a]]) @ way < _ALONG:
                return None
        arm = _unit(rest[at[f"{side}ForeArm"]] - rest[at[f"{side}Arm"]])
        if arm @ near[:, 0] * sign < -0.3:
            return None
    return near


def upright_axis(positions: np.ndarray, at: Mapping[str, int]) -> tuple[str, float]:
    """Return the world axis that is up in the mean over the frames ("X", "-Z", ...), and how surely (0 to 1).

    Up is where the neck is from the hips, and the hips from the feet.
    """
    feet = (positions[:, at["LeftFoot"]] + positions[:, at["RightFoot"]]) / 2
    hips = positions[:, at["Hips"]]
    mean = np.mean(_unit(positions[:, at["Neck"]] - hips) + _unit(hips - feet), axis=0) / 2
    k = int(np.abs(mean).argmax())
    return ("" if mean[k] > 0 else "-") + "XYZ"[k], float(abs(mean[k]))


def sides_agree(positions: np.ndarray, at: Mapping[str, int]) -> bool:
    """Return whether knees bend, and toes point, to where the hips' left and up say that forward is."""
    left = _unit(positions[:, at["LeftUpLeg"]] - positions[:, at["RightUpLeg"]])
    up = _unit(positions[:, at["Neck"]] - positions[:, at["Hips"]])
    forward = np.cross(left, up)
    votes = 0.0
    for side in _SIDES:
        hinge = _cross(positions, at, f"{side}UpLeg", f"{side}Leg", f"{side}Foot")
        votes += float((hinge * left).sum())
        if f"{side}ToeBase" in at:
            toes = _unit(positions[:, at[f"{side}ToeBase"]] - positions[:, at[f"{side}Foot"]])
            votes += float((toes * forward).sum())
    return votes >= 0


def shortest_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation by the smallest angle that takes direction `a` to `b`.

    Opposite directions have no shortest arc; they turn about the axis farthest from them.
    """
    a, b = _unit(a), _unit(b)
    axis = np.cross(a, b)
    if np.linalg.norm(axis) < 1e-9:
        axis = np.cross(a, np.eye(3)[np.abs(a).argmin()])
    angle = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    return Rotation.from_rotvec(_unit(axis) * angle).as_matrix()


def _trunk(R: np.ndarray, positions: np.ndarray, at: Mapping[str, int], role: str) -> np.ndarray:
    """Return left, up and forward of a joint of the trunk in its own axes, as columns `[3, 3]`."""
    hips = _unit(positions[:, at["LeftUpLeg"]] - positions[:, at["RightUpLeg"]])
    shoulders = _unit(positions[:, at["LeftArm"]] - positions[:, at["RightArm"]])
    left = hips if role == "Hips" else shoulders if role in ("Neck", "Head") else hips + shoulders
    up = _unit(positions[:, at["Neck"]] - positions[:, at["Hips"]])
    if role in ("Neck", "Head") and "Head" in at:
        above = positions[:, at["Head"]] - positions[:, at["Neck"]]
        up = up + _unit(above) if np.linalg.norm(above, axis=1).max() > 0 else up
    return _snapped(_square(_local_mean(R, left), _local_mean(R, up)))


def _hinges(positions: np.ndarray, at: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Return the limbs' hinge axes in the world `[t, 3]`, as long as the hinges are bent (sines).

    Those of limbs that are always straight lie across: hips' left for legs, trunk's up for arms.
    """
    found = {}
    up = _unit(positions[:, at["Neck"]] - positions[:, at["Hips"]])
    for side in _SIDES:
        left = _unit(positions[:, at["LeftUpLeg"]] - positions[:, at["RightUpLeg"]])
        straight = {
            "Leg": left,
            "Arm": np.cross(_unit(_bone(positions, at, f"{side}Arm")), np.cross(left, up)),
        }
        for kind, (a, b, c) in {"Leg": ("UpLeg", "Leg", "Foot"), "Arm": ("Arm", "ForeArm", "Hand")}.items():
            end = side + c if side + c in at else side + b
            hinge = _cross(positions, at, side + a, side + b, end)
            if np.linalg.norm(hinge, axis=1).max(initial=0.0) < _BENT:
                hinge = straight[kind]
            found[side + a] = found[side + b] = hinge
    return found


def _bone(positions: np.ndarray, at: Mapping[str, int], role: str) -> np.ndarray:
    side = next(s for s in _SIDES if role.startswith(s))
    return positions[:, at[side + _CHAIN[role.removeprefix(side)]]] - positions[:, at[role]]


def _cross(positions: np.ndarray, at: Mapping[str, int], a: str, b: str, c: str) -> np.ndarray:
    upper = _unit(positions[:, at[b]] - positions[:, at[a]])
    return np.cross(upper, _unit(positions[:, at[c]] - positions[:, at[b]]))


def _body_hinge(role: str, side: str, body: RiggedBody, roles: Mapping[str, int]) -> np.ndarray:
    """Return the hinge's axis in the canonical pose: left of a leg, across an arm that bends forward."""
    if role.endswith("Leg"):
        return np.array([1.0, 0.0, 0.0])
    x = body.joints.astype(np.float64)
    upper = _unit(x[roles[f"{side}ForeArm"]] - x[roles[f"{side}Arm"]])
    fore = _unit(x[roles[f"{side}Hand"]] - x[roles[f"{side}ForeArm"]]) if f"{side}Hand" in roles else upper
    bent = np.cross(upper, fore)
    return bent if np.linalg.norm(bent) > _BENT else np.cross(upper, [0.0, 0.0, 1.0])


def _as_above(rotations: np.ndarray, source: int, above: int, C: np.ndarray) -> np.ndarray:
    """Return the C that turns a joint like its parent in the mean over the frames."""
    mean = np.mean(np.swapaxes(rotations[:, source], -1, -2) @ rotations[:, above] @ C, axis=0)
    return nearest_rotations(mean)


def _local_mean(R: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Return the mean of world vectors `[t, 3]` in the axes of a joint `[t, 3, 3]`."""
    return np.einsum("tij,ti->j", R, vectors) / len(R)


def _square(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    x = _unit(left)
    y = _unit(up - (up @ x) * x)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _frame(along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Return axes `[3, 3]` of which the first is along a bone, the second as near `across` as that allows."""
    return _square(along, across)


def _nearest(axes: np.ndarray) -> np.ndarray:
    return _SIGNED_AXES[int(np.einsum("kij,ij->k", _SIGNED_AXES, axes).argmax())]


def _snapped(axes: np.ndarray) -> np.ndarray:
    near = _nearest(axes)
    return near if _angle(axes, near) < SNAP else axes


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arccos(np.clip((np.trace(a.T @ b) - 1) / 2, -1.0, 1.0)))


def _unit(v: np.ndarray) -> np.ndarray:
    """Return directions; 0 for what has none."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.zeros_like(v, dtype=np.float64), where=length > 0)


def _mapped_parent(j: int, sources: np.ndarray, body: RiggedBody) -> int:
    above = int(body.parents[j])
    while above > 0 and sources[above] < 0:
        above = int(body.parents[above])
    return max(above, 0)
