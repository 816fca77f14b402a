"""The structures that cross room borders, and the table of symbols.

Symbols (the paper's, section 3, as the code spells them):

    V, V_star      [n, 3]  garment of frame t, predicted and true; metres, root frame
    V_prev         [n, 3]  garment of frame t-1, re-expressed in frame t's root frame
    T              [n, 3]  garment template on the canonical body
    T_tilde        [n, 3]  unposed garment (decoded); T_tilde_star: by inverse skinning
    I_dyn, I_de    [n, 3]  dynamic offset, detail offset
    V_f            [n, 3]  after detail; V_resolved: after collision
    S_v, S_i       [h, w, 3]  UV position map, UV offset map (channels last)
    Z, z_s, z_d    [128], [64], [64]  latent code and its two factors
    M              [d]     motion features of one frame
    R_seed, t_seed [m, 3, 3], [m, 3]  seed transforms, canonical body -> posed body
    W              [n, m]  softmax skinning weights, rows sum to 1

All structures are NamedTuples. Those documented as "static" hold NumPy arrays that
are made once per template; the others hold arrays of one frame and may be traced.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:  # commands that read files alone start without jax
    import jax
    from jaxtyping import PyTree

    Array = np.ndarray | jax.Array


class RiggedBody(NamedTuple):
    """A skinned body in its canonical pose (static; metres, Y up, floor at 0)."""

    vertices: np.ndarray  # [b, 3] float32
    faces: np.ndarray  # [f, 3] int32, outward
    joints: np.ndarray  # [j, 3] float32 canonical positions; joint 0 is the root
    parents: np.ndarray  # [j] int32, -1 for the root
    joint_names: tuple[str, ...]  # j names
    skin_weights: np.ndarray  # [b, j] float32, rows sum to 1


class Collider(NamedTuple):
    """The closed part of a body that the cloth can touch (static).

    Its vertices are `body.vertices[body_vertices]` and, when `cap_loop` is not empty,
    one more: the mean of `body.vertices[cap_loop]`, appended last.
    """

    body_vertices: np.ndarray  # [c] int32 indices into the body
    cap_loop: np.ndarray  # [k] int32 indices into the body, may be empty
    faces: np.ndarray  # [f, 3] int32 indices into the collider's own vertices, outward


class Pins(NamedTuple):
    """Garment vertices that the body carries (static)."""

    vertices: np.ndarray  # [p] int32 indices into the garment
    weights: np.ndarray  # [p, j] float32 skinning weights, rows sum to 1


class Garment(NamedTuple):
    """A garment's template and its UV parametrisation (static; metres)."""

    template: np.ndarray  # [n, 3] float32 on the canonical body
    faces: np.ndarray  # [f, 3] int32
    uv: np.ndarray  # [u, 2] float32 in [0, 1]; a seam vertex has several
    faces_uv: np.ndarray  # [f, 3] int32 indices into uv


class Motion(NamedTuple):
    """The motion of a body over a clip (world frame).

    Joint j maps a canonical point x to R_j (x - joints_j) + p_j, where p follows from
    `root` by forward kinematics. The rotations of a long motion may stay in its file
    (`body.frame_windows`); then they are an object that slices like an array.
    """

    rotations: np.ndarray  # [t, j, 3, 3] world rotation of each joint from canonical
    root: np.ndarray  # [t, 3] world position of joint 0, metres
    fps: float


class Scene(NamedTuple):
    """Everything about a clip that does not change from frame to frame (static)."""

    garment: Garment
    body: RiggedBody
    collider: Collider | None
    pins: Pins | None


class ColumnFrame(NamedTuple):
    """The motion of one frame as the column RNN's ring of `a` columns takes it; leading axes stack."""

    seen: Array  # [a, f] features of each column (see column_rnn/motion)
    way: Array  # [a, 3] metres that each anchor moved since the last frame, in the column's frame
    turn: Array  # [] radians that cloth which hangs in the world turns about +Y as seen from the root
    anchor: Array  # [a, 3] metres, root frame


class ColumnCarry(NamedTuple):
    """What the ring carries from frame to frame; columns' frames."""

    X: jax.Array  # [*b, a, h, 3] metres from the anchors, the last frame's cells
    moved: jax.Array  # [*b, a, h, 3] metres that they moved in that frame
    h: jax.Array  # [*b, a, hidden]


class FrameInput(NamedTuple):
    """The motion of one frame as the networks take it; every field causal, leading axes stack."""

    M: Array  # [d] motion features, their own units (see body/motion_features)
    turn: Array  # [3, 3] a row vector v of frame t-1's root frame is v @ turn + shift in frame t's
    shift: Array  # [3] metres
    R: Array | None = (
        None  # [j, 3, 3] what poses a canonical garment (body/garment_skinning), into root frame
    )
    t: Array | None = None  # [j, 3] metres
    column_rnn: ColumnFrame | None = None  # None: latents alone


class TrainState(NamedTuple):
    """What a train step takes and returns: all that a resumed run needs."""

    params: PyTree  # nested dict of arrays; those that train
    opt_state: PyTree
    key: jax.Array  # PRNG key, split once per step
    step: jax.Array  # [] int32
    carry: PyTree = ()  # recurrent state that crosses window borders (motion, column RNN)
