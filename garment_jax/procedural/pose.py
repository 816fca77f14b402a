"""Joint angles of the human skeleton: their limits, and the world rotations that they make.

Angles are degrees about X, Y and Z of the canonical frame, `[t, 22, 3]` in the order of `JOINT_NAMES`, each
relative to the joint's parent. The right side's are given as for the left and mirrored here, so equal
numbers make a symmetric pose. For a left limb: -X bends the hip and lifts the toes, +X bends the knee and
the spine forward, +Z moves a limb away from the body, -Y bends the elbow.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.body.root_frame import yaw_matrix
from garment_jax.procedural.skeleton import JOINT_NAMES
from garment_jax.structs import RiggedBody

ORDER = "yzx"  # about the fixed axes: twist first, then sideways, then forward

_SPINE = ((-15.0, 25.0), (-20.0, 20.0), (-15.0, 15.0))
_LIMITS_BY_PART = {
    "Hips": ((-20.0, 25.0), (-15.0, 15.0), (-15.0, 15.0)),
    "LowerBack": _SPINE,
    "Spine": _SPINE,
    "Spine1": _SPINE,
    "Neck": ((-25.0, 25.0), (-30.0, 30.0), (-20.0, 20.0)),
    "Head": ((-25.0, 25.0), (-30.0, 30.0), (-20.0, 20.0)),
    "Shoulder": ((-15.0, 15.0), (-15.0, 15.0), (-10.0, 25.0)),
    "Arm": ((-70.0, 45.0), (-45.0, 45.0), (-25.0, 70.0)),
    "ForeArm": ((-20.0, 20.0), (-110.0, 5.0), (-20.0, 20.0)),
    "Hand": ((-30.0, 30.0), (-30.0, 30.0), (-30.0, 30.0)),
    "UpLeg": ((-110.0, 30.0), (-35.0, 35.0), (-25.0, 60.0)),
    "Leg": ((0.0, 130.0), (0.0, 0.0), (0.0, 0.0)),
    "Foot": ((-30.0, 50.0), (-20.0, 20.0), (-25.0, 25.0)),
    "ToeBase": ((-45.0, 30.0), (0.0, 0.0), (0.0, 0.0)),
}
# [22, 3, 2] degrees, lowest and highest
LIMITS = np.array([_LIMITS_BY_PART[name.removeprefix("Left").removeprefix("Right")] for name in JOINT_NAMES])
_MIRROR = np.array([[1.0, -1.0, -1.0] if name.startswith("Right") else [1.0] * 3 for name in JOINT_NAMES])


def joint(name: str) -> int:
    """Return the place of a joint in the angles."""
    return JOINT_NAMES.index(name)


def local_rotations(angles: np.ndarray) -> np.ndarray:
    """Return the rotations `[t, 22, 3, 3]` relative to the parents."""
    twist_first = (angles * _MIRROR)[..., [1, 2, 0]].reshape(-1, 3)
    return Rotation.from_euler(ORDER, twist_first, degrees=True).as_matrix().reshape(*angles.shape, 3)


def world_rotations(angles: np.ndarray, yaw: np.ndarray, body: RiggedBody) -> np.ndarray:
    """Return the world rotations `[t, j, 3, 3]` of the body's joints; `yaw` `[t]` in radians.

    Raises `ValueError` when the body lacks one of the 22 joints. Further joints follow their parents.
    """
    missing = [name for name in JOINT_NAMES if name not in body.joint_names]
    if missing:
        raise ValueError(
            f"the body has no joint {missing[0]!r}; rename its joints to {', '.join(JOINT_NAMES)}."
        )
    local = dict(zip(JOINT_NAMES, local_rotations(angles).swapaxes(0, 1), strict=True))
    world = np.zeros((len(angles), len(body.joint_names), 3, 3))
    for j, (name, parent) in enumerate(zip(body.joint_names, body.parents.tolist(), strict=True)):
        above = yaw_matrix(yaw) if parent < 0 else world[:, parent]
        world[:, j] = above @ local.get(name, np.eye(3))
    return world
