"""The body of a motion as the local dynamics read it: a transform for each joint and frame."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.body.kinematics import joint_positions
from garment_jax.body.root_frame import carry_over, heading, to_root, yaw_matrix
from garment_jax.dynamics.tables import Carriers
from garment_jax.structs import Motion, RiggedBody


class BodyFrame(NamedTuple):
    """The body of one frame and of the one before; every field causal, leading axes stack."""

    A: Any  # [j, 3, 4] canonical root frame -> this frame's root frame, metres
    A_prev: Any  # [j, 3, 4] the last frame's, in its own root frame
    turn: Any  # [3, 3] as in `FrameInput`
    shift: Any  # [3] metres


def body_frames(motion: Motion, body: RiggedBody) -> BodyFrame:
    """Return the frames of `motion`, leaves `[t, ...]` float32; computed in float64 (host)."""
    root = motion.root.astype(np.float64)
    yaw = heading(motion.rotations[:, 0])
    rotations = motion.rotations.astype(np.float64)
    positions = to_root(joint_positions(rotations, root, body), root, yaw)
    R = np.swapaxes(yaw_matrix(yaw), -1, -2)[:, None] @ rotations
    rest = (body.joints - body.joints[0]).astype(np.float64)
    offset = positions - (R @ rest[..., None])[..., 0]
    A = np.concatenate([R, offset[..., None]], axis=-1)
    turn, shift = carry_over(root, yaw)
    A = A.astype(np.float32)
    return BodyFrame(A, np.concatenate([A[:1], A[:-1]]), turn, shift)


def still(frame: BodyFrame) -> BodyFrame:
    """Return the body of one frame at rest."""
    return BodyFrame(frame.A, frame.A, np.eye(3, dtype=np.float32), np.zeros(3, np.float32))


def posed(A: Float[Array, "*b j 3 4"], carriers: Carriers) -> Float[Array, "*b q 3"]:
    """Return the points that the body carries, metres."""
    blend = blended(A, carriers)
    return jnp.einsum("...qik,qk->...qi", blend[..., :3], carriers.points) + blend[..., 3]


def turned(A: Float[Array, "*b j 3 4"], carriers: Carriers, directions: np.ndarray) -> Float[Array, "*b q 3"]:
    """Return canonical `directions` `[q, 3]` at the points as the body turns them."""
    return jnp.einsum("...qik,qk->...qi", blended(A, carriers)[..., :3], directions)


def blended(A: Float[Array, "*b j 3 4"], carriers: Carriers) -> Float[Array, "*b q 3 4"]:
    """Return the blend of the joints' transforms at each point."""
    return jnp.einsum("qj,...jik->...qik", carriers.weights, A)


def carried(V: Float[Array, "*b n 3"], frame: BodyFrame) -> Float[Array, "*b n 3"]:
    """Re-express points of the last frame's root frame in this frame's."""
    return V @ jnp.asarray(frame.turn) + jnp.asarray(frame.shift)[..., None, :]


def last_body(frame: BodyFrame) -> Float[Array, "*b j 3 4"]:
    """Return the last frame's transforms as seen from this frame's root frame."""
    # `turn` acts on rows; in front of columns it is its transpose
    A = jnp.einsum("...ki,...jkl->...jil", frame.turn, frame.A_prev)
    return A.at[..., 3].add(jnp.asarray(frame.shift)[..., None, :])
