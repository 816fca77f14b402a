"""One frame in, one frame out: the networks and all that follows them, from a skeleton to world vertices.

`init` and `step` are pure functions of arrays, for `jax.jit`, `jax.vmap` and engines. What `animate` computes
on the host in float64 for whole motions is here one frame in float32, so vertices agree to about a tenth of a
millimetre where a rollout does not branch.
"""

import sys
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from garment_jax.api.arguments import a_flag, shown, takes
from garment_jax.api.loaded import LoadedModel
from garment_jax.api.model_argument import a_model
from garment_jax.exporters.column_rnn_functions import ColumnState, begun, column_input
from garment_jax.exporters.host_functions import (
    first_frame,
    frame_input,
    heading,
    joints_from_root,
    pose_carried,
    yaw_matrix,
)
from garment_jax.geometry.skinning import softmax_weights
from garment_jax.io.validation import check_poses, check_shapes, real_numbers
from garment_jax.model import compose
from garment_jax.model.compose import RolloutState, init_state
from garment_jax.model.motion.network import MotionCarry
from garment_jax.postprocess.pipeline import (
    BodyFrame,
    ContactState,
    ShapeState,
    contact_init,
    contact_step,
    shape_init,
    shape_step,
)
from garment_jax.structs import FrameInput, Motion

Numbers = np.ndarray | jax.Array
# rotations [j, 3, 3] of the joints from the canonical pose, and root [3], joint 0's position; metres, world
Skeleton = tuple[Numbers, Numbers]
_Skeleton = tuple[jax.Array, jax.Array]


class State(NamedTuple):
    """What a frame hands to the next."""

    skeleton: _Skeleton  # of the last frame
    networks: MotionCarry
    columns: ColumnState | None  # of the column RNN; None: latents alone
    shape: ShapeState | None  # pins, strain, edge lengths; None: the networks alone
    contacts: ContactState | None  # None: collisions are not handled


def _a_state(name: str, value: Any) -> State:
    if not isinstance(value, State):
        raise ValueError(f"{name}={shown(value)} is no state; give what gj.init or gj.step returned.")
    return value


def _a_skeleton(name: str, value: Any) -> Skeleton:
    """Return rotations and root as arrays of real numbers; what is traced stays as it is."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise ValueError(f"{name}={shown(value)} is no pair of arrays; give (rotations, root).")
    rotations, root = (
        x if isinstance(x, jax.Array) and not jnp.iscomplexobj(x) else real_numbers(x, f"{name}: {part}")
        for part, x in zip(("rotations", "root"), value, strict=True)
    )
    return rotations, root


@takes(model=a_model, frame=_a_skeleton, collision=a_flag, postprocess=a_flag)
def init(model: LoadedModel, frame: Skeleton, *, collision: bool = True, postprocess: bool = True) -> State:
    """Return the state before the first frame, whose skeleton is `frame`; the garment hangs on it at rest.

    `frame`: rotations `[j, 3, 3]` of the joints from the canonical pose and the root's position `[3]`;
    metres, world, Y up. `collision` off leaves collisions unhandled, `postprocess` off all that comes after
    the networks, which are differentiable; `step` and `rollout` follow the state. Raises `ValueError` for
    what is no skeleton of the model's body, as these do: by its values where they are known, not traced.

        rotations, root, fps = model.motion
        state = gj.init(model, (rotations[0], root[0]))
    """
    skeleton = _arrays(model, frame)
    networks, columns = _begun(model, skeleton)
    state = State(skeleton, networks, columns, None, None)
    if not postprocess:
        return state
    _, V, body = _networks(model, state, skeleton)
    shape = shape_init(V, body, tables=model.tables.shape)
    if not collision or model.tables.contacts is None:
        return state._replace(shape=shape)
    _, V = _shape(model, shape, V, body)
    return state._replace(shape=shape, contacts=_contacts_begun(model, V, body))


@takes(model=a_model, state=_a_state, frame=_a_skeleton)
def step(model: LoadedModel, state: State, frame: Skeleton) -> tuple[State, Float[Array, "n 3"]]:
    """Return the next state and the garment of this frame, metres, world; nothing from the future.

    `frame`: as of `init`, a frame of `1 / model.fps` seconds after the last. Compiled at the first call,
    which takes a minute or two, once on a machine; then milliseconds. Pure: wrap it in `jax.jit`, `jax.vmap`
    or `jax.lax.scan` freely.

        for frame in zip(rotations, root):
            state, V = gj.step(model, state, frame)
    """
    skeleton = _arrays(model, frame)
    state, V, body = _networks(model, state, skeleton)
    if state.shape is not None:
        shape, V = _shape(model, state.shape, V, body)
        state = state._replace(shape=shape)
    if state.contacts is not None:
        contacts, V = _contacts(model, state.contacts, V, body)
        state = state._replace(contacts=contacts)
    return state, _placed(V, skeleton)


@takes(model=a_model, state=_a_state, frames=_a_skeleton)
def rollout(model: LoadedModel, state: State, frames: Skeleton) -> tuple[State, Float[Array, "t n 3"]]:
    """Return the state after `t` frames and every frame's garment, metres, world: a scan of `step`.

    `frames`: rotations `[t, j, 3, 3]` and roots `[t, 3]`. Several motions side by side: `jax.vmap` of it.

        state, V = gj.rollout(model, state, (rotations, root))    # [t, n, 3]
    """
    return _rollout(model, state, _arrays(model, frames, one_frame=False))


@jax.jit
def _rollout(model: LoadedModel, state: State, frames: _Skeleton) -> tuple[State, jax.Array]:
    return jax.lax.scan(partial(step, model), state, frames)


def _arrays(model: LoadedModel, skeleton: Skeleton, *, one_frame: bool = True) -> _Skeleton:
    """Return arrays as float32; `ValueError` for wrong shapes, and for no pose where values are known."""
    name, joints = "the frame" if one_frame else "the motion", model.scene.body.joint_names
    check_shapes(skeleton[0].shape, skeleton[1].shape, name, joints=joints, one_frame=one_frame)
    if not any(isinstance(x, Tracer) for x in skeleton):
        rotations, root = (np.asarray(x)[None] if one_frame else np.asarray(x) for x in skeleton)
        check_poses(Motion(rotations, root, model.fps), name, joints=joints)
    rotations, root = skeleton
    return jnp.asarray(rotations, jnp.float32), jnp.asarray(root, jnp.float32)


@jax.jit
def _begun(model: LoadedModel, skeleton: _Skeleton) -> tuple[MotionCarry, ColumnState | None]:
    """Return the networks' states: the template carried by the body, and the ring at rest."""
    template, config = model.template, model.config
    V = jnp.asarray(template.T)  # in canonical pose a template that the joints carry is itself
    if template.W is None:
        W = softmax_weights(V, jnp.asarray(model.seeds.points), tau=config.body.tau)
        V = first_frame(model.scene, model.seeds, template.T, W, skeleton[0])
    columns = None
    if template.ring is not None:
        columns = begun(model.scene, template.ring, config.column_rnn, skeleton[0])
    return init_state(model.params, V, template=template, config=config).motion, columns


@jax.jit
def _networks(
    model: LoadedModel, state: State, skeleton: _Skeleton
) -> tuple[State, Float[Array, "n 3"], BodyFrame]:
    """Return the state with the networks' next, their garment (root frame), and what the body carries."""
    # Said while this is traced, so once for each thing that is compiled: a silent minute looks broken.
    print(
        "preparing a frame's step, a minute or two where it was not compiled here before",
        file=sys.stderr,
        flush=True,
    )
    scene, config = model.scene, model.config
    skeletons = (*skeleton, *state.skeleton)
    frame = frame_input(scene, config.body.motion_joints, model.fps, *skeletons)
    x = FrameInput(frame.M, frame.turn, frame.shift, frame.R, frame.t)
    columns, ring = state.columns, model.template.ring
    if columns is not None and ring is not None:
        seen, columns = column_input(scene, ring, columns, *skeletons)
        x = x._replace(column_rnn=seen)
    before = RolloutState(state.networks, None if columns is None else columns.carry)
    after, V = compose.step(model.params, before, x, template=model.template, config=config)
    if columns is not None and after.column_rnn is not None:
        columns = columns._replace(carry=after.column_rnn)
    state = state._replace(skeleton=skeleton, networks=after.motion, columns=columns)
    return state, V, _body(model, skeleton[0])


def _body(model: LoadedModel, rotations: Float[Array, "j 3 3"]) -> BodyFrame:
    """Return what the body carries, metres, root frame."""
    carried, body = model.carried, model.scene.body
    points = pose_carried(carried, body, rotations)
    joints = joints_from_root(rotations, body) @ yaw_matrix(*heading(rotations[0]))
    p = len(carried.pins)
    return BodyFrame(points[:p], points[p:], joints[carried.bones])


@jax.jit
def _shape(
    model: LoadedModel, state: ShapeState, V: Float[Array, "n 3"], body: BodyFrame
) -> tuple[ShapeState, Float[Array, "n 3"]]:
    return shape_step(state, V, body, tables=model.tables.shape)[:2]


@jax.jit
def _contacts_begun(model: LoadedModel, V: Float[Array, "n 3"], body: BodyFrame) -> ContactState:
    assert model.tables.contacts is not None
    return contact_init(V, body, tables=model.tables.contacts)


@jax.jit
def _contacts(
    model: LoadedModel, state: ContactState, V: Float[Array, "n 3"], body: BodyFrame
) -> tuple[ContactState, Float[Array, "n 3"]]:
    assert model.tables.contacts is not None
    return contact_step(state, V, body, tables=model.tables.contacts)[:2]


@jax.jit
def _placed(V: Float[Array, "n 3"], skeleton: _Skeleton) -> Float[Array, "n 3"]:
    """Return a garment of a root frame in the world."""
    rotations, root = skeleton
    return V @ yaw_matrix(*heading(rotations[0])).T + root[None]
