"""A new motion out of three: one dancer's left leg and trunk, another's right leg, a third's turns.

Variations of a clip stay the same dance, and a garment model judged on an unseen dance errs several times
as much as on an unseen variation. Crossed motions need no new captures. Feet may slide and do not matter
to the cloth; what the legs do to each other is for the screening of the simulated clip to judge.
"""

import numpy as np

from garment_jax.body.root_frame import heading, yaw_matrix
from garment_jax.structs import Motion, RiggedBody

CROSSED = "RightUpLeg"  # this joint and all below it come from the second motion


def cross_motions(
    first: Motion, second: Motion, third: Motion, body: RiggedBody, *, joint: str = CROSSED
) -> Motion:
    """Return `first` with the limb from `joint` on of `second` and the heading of `third`.

    As long as the shortest of the three, whose frame rates must be equal. The travel is the first one's,
    in the heading's frame. Raises `ValueError` for a joint that the body lacks, or other frame rates.
    """
    if joint not in body.joint_names:
        raise ValueError(
            f"the body has no joint {joint!r} to cross at; it has {', '.join(body.joint_names)}."
        )
    if not first.fps == second.fps == third.fps:
        raise ValueError(
            f"motions of {first.fps:g}, {second.fps:g} and {third.fps:g} fps cannot be crossed; "
            "resample them."
        )
    frames = min(len(motion.root) for motion in (first, second, third))
    a, b, c = (motion.rotations[:frames].astype(np.float64) for motion in (first, second, third))
    turn = heading(c[:, 0]) - heading(c[:1, 0]) + heading(a[:1, 0]) - heading(a[:, 0])
    rotations = _with_limb(a, b, body, joint)
    yaw = yaw_matrix(turn)
    steps = np.einsum("tab,tb->ta", yaw[:-1], np.diff(first.root[:frames], axis=0))
    root = first.root[:1] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return Motion((yaw[:, None] @ rotations).astype(first.rotations.dtype), root, first.fps)


def _with_limb(a: np.ndarray, b: np.ndarray, body: RiggedBody, joint: str) -> np.ndarray:
    """Return `a` `[t, j, 3, 3]` with the joints from `joint` on turned as in `b`."""
    R, parents = a.copy(), body.parents.tolist()
    below = {body.joint_names.index(joint)}
    for j, parent in enumerate(parents):
        if parent in below:
            below.add(j)
        if j in below:
            R[:, j] = R[:, parent] @ (np.swapaxes(b[:, parent], -1, -2) @ b[:, j])
    return R
