"""The mirror image of a motion: left and right exchanged (doubles the data of a symmetric body)."""

import numpy as np

from garment_jax.structs import Motion, RiggedBody

FLIP = np.array([-1.0, 1.0, 1.0])


def mirror_motion(motion: Motion, body: RiggedBody) -> Motion:
    """Return `motion` mirrored in the plane x = 0 of the world.

    Raises `ValueError` when a Left… joint has no Right… partner or the skeleton is not symmetric
    within 1 cm.
    """
    partner = joint_partners(body)
    error = np.abs(body.joints[partner] * FLIP - body.joints).max()
    if error > 0.01:
        raise ValueError(
            f"the skeleton is not left-right symmetric (joints differ by {error * 100:.1f} cm); "
            "set data.mirror = false (--data.mirror false)."
        )
    rotations = motion.rotations[:, partner] * FLIP[:, None] * FLIP[None, :]
    return Motion(rotations, motion.root * FLIP, motion.fps)


def joint_partners(body: RiggedBody) -> list[int]:
    """Return which joint each one becomes in the mirror; `ValueError` for a Left… without a Right…."""
    return [_partner(name, body) for name in body.joint_names]


def _partner(name: str, body: RiggedBody) -> int:
    swapped = name.replace("Left", "\0").replace("Right", "Left").replace("\0", "Right")
    if swapped not in body.joint_names:
        raise ValueError(
            f"joint {name!r} has no partner {swapped!r}; set data.mirror = false (--data.mirror false)."
        )
    return body.joint_names.index(swapped)
