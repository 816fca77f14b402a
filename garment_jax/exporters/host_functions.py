"""What a host computes from its skeleton before each step, as JAX functions that become graphs.

The package itself does this on the host in float64 for whole motions (body/motion_features, body/seeds,
data/motion_input). Here it is one frame in float32, with what a graph can hold: no SVD and no arctangent of
two numbers. Tests hold both against each other.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from garment_jax.body.carried import Carried
from garment_jax.body.garment_skinning import FREE_ANGLE
from garment_jax.body.motion_features import joint_indices
from garment_jax.body.seeds import Seeds
from garment_jax.structs import RiggedBody, Scene

NEWTON_STEPS = 12  # of the polar factor: enough for a blend whose smallest singular value is 0.01


class Frame(NamedTuple):
    """What the step takes of a frame, and what puts its garment into the world."""

    M: jax.Array  # [d] motion features
    turn: jax.Array  # [3, 3]
    shift: jax.Array  # [3] metres
    R: jax.Array  # [j, 3, 3] what poses a canonical garment, canonical -> root frame
    t: jax.Array  # [j, 3] metres
    to_world: jax.Array  # [3, 3] world = V @ to_world + root
    pins: jax.Array  # [p, 3] metres, root frame; p may be 0


def frame_input(
    scene: Scene,
    joints: tuple[str, ...],
    fps: float,
    rotations: Float[Array, "j 3 3"],
    root: Float[Array, " 3"],
    rotations_prev: Float[Array, "j 3 3"],
    root_prev: Float[Array, " 3"],
) -> Frame:
    """Return the step's inputs from the skeleton of this frame and of the last.

    World rotations from the canonical pose and world positions of joint 0, metres, Y up, as in
    `structs.Motion`. The layout of M is that of `body/motion_features`.
    """
    body, chosen = scene.body, joint_indices(scene.body, joints)
    yaw, yaw_prev = heading(rotations[0]), heading(rotations_prev[0])
    Y = yaw_matrix(*yaw)
    every, every_prev = joints_from_root(rotations, body), joints_from_root(rotations_prev, body)
    here = jnp.take(every, chosen, axis=0, mode="clip")
    moved, walked = here - jnp.take(every_prev, chosen, axis=0, mode="clip"), root - root_prev
    parents = np.maximum(body.parents[chosen], 0)
    P = jnp.take(rotations, parents, axis=0, mode="clip")
    R = jnp.take(rotations, chosen, axis=0, mode="clip")
    relative = (P[:, :, :, None] * R[:, :, None, :]).sum(axis=1)
    turned = yaw[0] * yaw_prev[0] + yaw[1] * yaw_prev[1], yaw[1] * yaw_prev[0] - yaw[0] * yaw_prev[1]
    parts = [
        (Y.T @ rotations[0])[:, :2],
        relative[:, :, :2],
        fps * (walked @ Y),
        fps * angle(*turned)[None],
        fps * ((moved + walked[None]) @ Y),
        here @ Y,
    ]
    M = jnp.concatenate([part.reshape(-1) for part in parts])
    facing = (Y[None, :, :, None] * rotations[:, :, None, :]).sum(axis=1)  # Y^T R_j
    R_root = _turned_less(facing, np.radians(FREE_ANGLE))
    rest = (body.joints - body.joints[0]).astype(np.float32)
    t_root = joints_from_root(R_root, body) - (R_root * rest[:, None, :]).sum(axis=-1)
    pins = _pins(scene, rotations, every) @ Y
    return Frame(M, yaw_matrix(*turned), -walked @ Y, R_root, t_root, Y.T, pins)


def first_frame(
    scene: Scene,
    seeds: Seeds,
    T: Float[np.ndarray, "n 3"],
    W: Float[np.ndarray, "n m"] | Float[Array, "n m"],
    rotations: Float[Array, "j 3 3"],
) -> Float[Array, "n 3"]:
    """Return the template `T` carried by its seeds (weights `W`), metres, root frame of this skeleton."""
    joints, origin = joints_from_root(rotations, scene.body), scene.body.joints[0]
    A, posed = _posed(seeds.points + origin, seeds.weights, rotations, joints, scene.body)
    Y = yaw_matrix(*heading(rotations[0]))
    R = _nearest_rotation(A)
    t = posed - (R * seeds.points[:, None, :]).sum(axis=-1)
    blended = jnp.matmul(W, R.reshape(-1, 9)).reshape(-1, 3, 3)
    return ((blended * T[:, None, :]).sum(axis=-1) + jnp.matmul(W, t)) @ Y


def heading(R: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return cosine and sine of the yaw of a root rotation; 1 and 0 where it hangs upside down."""
    sine, cosine = R[0, 2] - R[2, 0], R[0, 0] + R[2, 2]
    square = sine * sine + cosine * cosine
    none = square < 1e-12
    length = jnp.sqrt(jnp.where(none, 1.0, square))
    return jnp.where(none, 1.0, cosine / length), jnp.where(none, 0.0, sine / length)


def yaw_matrix(c: jax.Array, s: jax.Array) -> jax.Array:
    o, i = jnp.zeros_like(c), jnp.ones_like(c)
    return jnp.stack([c, o, s, o, i, o, -s, o, c]).reshape(3, 3)


def angle(cosine: jax.Array, sine: jax.Array) -> jax.Array:
    """Return the angle in radians, by the half angle; at half a turn, where it has no sign, finite."""
    return 2.0 * jnp.arctan(sine / jnp.maximum(1.0 + cosine, 1e-6))


def joints_from_root(rotations: jax.Array, body: RiggedBody) -> jax.Array:
    """Return the joints' positions less the root's, `[j, 3]`: each the sum of the bones above it."""
    parents = np.maximum(body.parents, 0)
    above = np.zeros((len(parents), len(parents)), np.float32)
    for j in range(1, len(parents)):
        above[j] = above[parents[j]]
        above[j, j] = 1.0
    bone = (body.joints - body.joints[parents]).astype(np.float32)
    R = jnp.take(rotations, parents, axis=0, mode="clip")
    return jnp.asarray(above) @ (R * bone[:, None, :]).sum(axis=-1)


def pose_carried(carried: Carried, body: RiggedBody, rotations: Float[Array, "j 3 3"]) -> Float[Array, "q 3"]:
    """Return the pins, then the collider's vertices, metres, root frame (as `body.carried.pose_carried`)."""
    joints = jnp.asarray(carried.joints)
    R = jnp.take(rotations, joints, axis=0, mode="clip")
    at = jnp.take(joints_from_root(rotations, body), joints, axis=0, mode="clip")
    offset = at - (R * body.joints[carried.joints].astype(np.float32)[:, None, :]).sum(axis=-1)
    affine = jnp.concatenate([R.transpose(0, 2, 1), offset[:, None, :]], axis=1).reshape(-1, 3)
    points = jnp.asarray(carried.weighted.toarray().astype(np.float32)) @ affine
    return points @ yaw_matrix(*heading(rotations[0]))


def _posed(
    points: np.ndarray, weights: np.ndarray, rotations: jax.Array, joints: jax.Array, body: RiggedBody
):
    """Return the blended matrices `[q, 3, 3]` at canonical `points` and the points posed, less the root."""
    A = (jnp.asarray(weights) @ rotations.reshape(-1, 9)).reshape(-1, 3, 3)
    offset = joints - (rotations * body.joints[:, None, :]).sum(axis=-1)
    return A, (A * points[:, None, :]).sum(axis=-1) + weights @ offset


def _turned_less(R: jax.Array, angle: float) -> jax.Array:
    """Return what `garment_skinning.turned_less` does, of `[j, 3, 3]`."""
    odd, even = 0.5 * (R - R.swapaxes(1, 2)), 0.5 * (R + R.swapaxes(1, 2))
    cosine = (0.5 * (R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2] - 1.0))[:, None, None]
    square = (0.5 * (odd * odd).sum(axis=(1, 2)))[:, None, None]
    told = square > 1e-12
    sine = jnp.where(told, jnp.sqrt(jnp.where(told, square, 1.0)), 0.0)
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    eye, beyond = jnp.eye(3)[None], cosine < c
    outer = (even - cosine * eye) / jnp.where(beyond, 1.0 - cosine, 1.0)
    cross = jnp.where(told, odd / jnp.where(told, sine, 1.0), 0.0)
    less, across = cosine * c + sine * s, sine * c - cosine * s
    return jnp.where(beyond, less * eye + (1.0 - less) * outer + across * cross, eye)


def _pins(scene: Scene, rotations: jax.Array, joints: jax.Array) -> jax.Array:
    if scene.pins is None:
        return jnp.zeros((0, 3))
    points = scene.garment.template[scene.pins.vertices]
    return _posed(points, scene.pins.weights, rotations, joints, scene.body)[1]


def _nearest_rotation(A: jax.Array) -> jax.Array:
    """Return the rotation nearest to each `A` `[q, 3, 3]`: Newton's iteration X <- (X + X^-T) / 2.

    Quadratic from above; a singular matrix, which a blend of opposite rotations is, has no nearest one.
    """
    x = A.reshape(-1, 9).T  # [9, q]: cofactors are then four gathers of whole rows
    row, column = np.divmod(np.arange(9), 3)
    down, down2 = 3 * ((row + 1) % 3), 3 * ((row + 2) % 3)
    right, right2 = (column + 1) % 3, (column + 2) % 3
    for _ in range(NEWTON_STEPS):
        a, b, c, d = (
            jnp.take(x, index, axis=0, mode="clip")
            for index in (down + right, down2 + right2, down + right2, down2 + right)
        )
        cofactors = a * b - c * d
        det = (x[:3] * cofactors[:3]).sum(axis=0)
        x = 0.5 * (x + cofactors / jnp.where(jnp.abs(det) < 1e-9, 1e-9, det)[None])
    return x.T.reshape(-1, 3, 3)
