"""The trainings of `equal_frames.py`: steps, first states, and batches cut out of frames on the device."""

import itertools
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from learnt_frames import Knowledge, Learnt, template_of
from swing_from_simulation import say

from garment_jax.baselines.bones import bones_of
from garment_jax.body.mirror import FLIP
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.structs import FrameInput, TrainState
from garment_jax.swing.motion import SwingFrame

STAGES = ("warm_up", "codes", "swing", "bones", "residual", "santesteban")
LANES = {"warm_up": 256, "codes": 64, "swing": 256, "bones": 256, "residual": 64, "santesteban": 256}
WINDOWS = 6_000  # of each stage, again and again


class Frames(NamedTuple):
    """All clips' frames, one after the other (device)."""

    frames: SwingFrame
    X: Any
    M: Any
    R: Any
    t: Any
    bones: Any
    coefficients: Any
    Z: Any
    U: Any  # of clips that are no mirror images


class Places(NamedTuple):
    """Which frames a window's lanes see (host)."""

    at: np.ndarray  # [L] the first, of all frames
    in_U: np.ndarray  # [L] the first, of those in U
    mirrored: np.ndarray  # [L]
    begins: np.ndarray  # [L] it is a clip's first
    fresh: np.ndarray
    true: np.ndarray
    weight: np.ndarray  # [W, L]
    unknowing: np.ndarray  # [W, L]


def optimiser_of(weight_decay: float) -> Any:
    """Return AdamW, clipped to a norm of 1, with a learning rate that is set from outside."""
    import optax

    adam = optax.inject_hyperparams(optax.adamw)(learning_rate=0.0, weight_decay=weight_decay)
    return optax.chain(optax.clip_by_global_norm(1.0), adam)


def make_stages(knowledge: Knowledge, wanted: dict[str, float]) -> dict[str, Any]:
    """Return name -> (step, () -> first state, (frames, places) -> batch), and what the stages share."""
    import jax
    import jax.numpy as jnp
    import optax

    from garment_jax.baselines import pan, pan_network, pan_residual, santesteban
    from garment_jax.baselines.features import columns
    from garment_jax.baselines.recurrent import WindowBatch, init_recurrent, make_window_step
    from garment_jax.motion.network import normalise_motion
    from garment_jax.motion.train_step import MotionBatch, empty_carry, make_motion_train_step
    from garment_jax.motion.warm_up import (
        LinearGarment,
        WarmUpBatch,
        empty_warm_up_carry,
        make_warm_up_step,
        pooled_map,
    )
    from garment_jax.swing.network import at_rest
    from garment_jax.swing.tables import make_swing_tables
    from garment_jax.swing.train_step import SwingBatch, make_swing_train_step

    model, scene, known = knowledge.model, knowledge.sources.scene, knowledge.known
    config, motion = model.config, model.config.motion
    template = template_of(model, scene)._replace(ring=None)
    linear = LinearGarment(*(known[name] for name in LinearGarment._fields))
    mirror, flip = mirror_permutation(scene.garment), jnp.asarray(FLIP, jnp.float32)
    bones = bones_of(template.T, known["bones"])
    rig = pan_network.make_rig(template, bones, known["bone_mean"], known["bone_deviation"])
    n = len(template.T)

    def adam(decay: float = motion.weight_decay) -> Any:
        return optimiser_of(decay)

    def first(params: Any, optimiser: Any, carry: Any = None) -> TrainState:
        params = jax.tree.map(lambda x: jnp.array(x, jnp.float32), params)
        opt_state = optimiser.init(params)
        opt_state[1].hyperparams["learning_rate"] = jnp.float32(0.0)  # of the type that it will be set to
        return TrainState(params, opt_state, jax.random.key(1), jnp.int32(0), carry)

    def which(at: jax.Array, window: int) -> jax.Array:
        return at[None] + jnp.arange(window)[:, None]

    def unposed(data: Frames, places: Places, window: int) -> jax.Array:
        U = data.U[which(places.in_U, window)].astype(jnp.float32)
        return jnp.where(places.mirrored[None, :, None, None], U[:, :, mirror] * flip, U)

    def starts(data: Frames, places: Places) -> jax.Array:
        back = places._replace(in_U=places.in_U - ~places.begins)
        U = unposed(data, back, 1)[0]
        return jnp.where((places.fresh & places.true)[:, None, None], U, jnp.asarray(template.T))

    def motion_of(data: Frames, places: Places, window: int) -> FrameInput:
        w = which(places.at, window)
        eye = jnp.zeros((*w.shape, 3, 3))
        return FrameInput(data.M[w], eye, eye[..., 0], data.R[w], data.t[w])

    def warm_batch(data: Frames, places: Places) -> WarmUpBatch:
        start = pooled_map(starts(data, places), template)
        x = motion_of(data, places, motion.window)
        Z = data.Z[which(places.at, motion.window)]
        return WarmUpBatch(x, Z, places.weight, places.fresh, start)

    def codes_batch(data: Frames, places: Places) -> MotionBatch:
        from garment_jax.generative.canonical import posed

        x = motion_of(data, places, motion.window)
        V = posed(unposed(data, places, motion.window), x, template=template)
        Z = data.Z[which(places.at, motion.window)]
        return MotionBatch(x, V, Z, places.weight, places.fresh, starts(data, places))

    tables = make_swing_tables(scene, config=config.swing)

    def swing_batch(data: Frames, places: Places) -> SwingBatch:
        begins = places.begins[:, None, None, None]
        start = jnp.where(begins, tables.rest, data.X[jnp.maximum(places.at - 1, 0)])
        w = which(places.at, config.swing.window)
        cut = SwingFrame(*(leaf[w].astype(jnp.float32) for leaf in data.frames))
        return SwingBatch(cut, data.X[w], places.fresh, start, places.fresh & ~places.begins)

    def inputs(data: Frames, places: Places, chosen: np.ndarray) -> jax.Array:
        return normalise_motion(data.M[which(places.at, motion.window)], template)[..., chosen]

    chosen_pan, chosen_pose = (columns(scene.body, config, m.READS) for m in (pan, santesteban))

    def bones_batch(data: Frames, places: Places) -> WindowBatch:
        target = data.bones[which(places.at, motion.window)]
        return WindowBatch(inputs(data, places, chosen_pan), target, places.unknowing, places.fresh)

    def pose_batch(data: Frames, places: Places) -> WindowBatch:
        target = data.coefficients[which(places.at, motion.window)]
        return WindowBatch(inputs(data, places, chosen_pose), target, places.unknowing, places.fresh)

    warm, full, ring = adam(), adam(), adam(config.swing.weight_decay)
    low_, pose, high_ = adam(1e-3), adam(1e-3), adam(1e-3)
    lanes = LANES
    key = jax.random.key(knowledge.sources.seed)
    error = pan.bone_error(rig, pan.weighted_rest(template.T, bones))

    def residual_step(state: TrainState, batch: Any) -> Any:
        gradient, metrics = jax.grad(pan_residual.residual_loss, has_aux=True)(
            state.params, batch, rig=rig, template=template, config=config.detail
        )
        updates, opt_state = high_.update(gradient, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        return TrainState(params, opt_state, state.key, state.step + 1), metrics

    settings = config.baselines
    outputs = int(np.prod(known["bone_mean"].shape))
    low_params = init_recurrent(key, inputs=len(chosen_pan), width=settings.pan_gru, outputs=outputs)
    pose_params = init_recurrent(
        key, inputs=len(chosen_pose), width=settings.santesteban_gru, outputs=len(known["deviation"])
    )
    high_params = pan_network.init_high(key, template, bones=settings.bones, width=settings.pan_residual_gru)
    generative = config.generative
    frozen = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), model.params["generative"])
    rest = at_rest(tables, (lanes["swing"],), config=config.swing)

    def residual_batch(data: Frames, places: Places, low: dict) -> Any:
        from garment_jax.baselines.recurrent import recur
        from garment_jax.generative.canonical import posed

        h = jnp.zeros((len(places.at), settings.pan_gru))
        x = recur(low, h, inputs(data, places, chosen_pan))[1]
        at = jnp.where(places.begins, 0, motion.window // 2)
        at = at + (jnp.arange(len(at)) * 7919) % (motion.window // 2)
        there = places._replace(at=places.at + at, in_U=places.in_U + at)
        one = motion_of(data, there, 1)
        V = posed(unposed(data, there, 1), one, template=template)[0]
        return pan_residual.ResidualBatch(x, at, V)

    deviation = known["deviation"]
    made: dict[str, Any] = {
        "warm_up": (
            make_warm_up_step(linear, template, motion, warm),
            lambda: first(
                model.params["motion"], warm, empty_warm_up_carry(lanes["warm_up"], linear, motion)
            ),
            warm_batch,
        ),
        "codes": (
            jax.jit(make_motion_train_step(template, frozen, motion, generative, full), donate_argnums=0),
            lambda: first(model.params["motion"], full, empty_carry(lanes["codes"], n, motion)),
            codes_batch,
        ),
        "swing": (
            make_swing_train_step(tables, config.swing, ring),
            lambda: first(model.params["swing"], ring, jax.tree.map(jnp.array, rest)),
            swing_batch,
        ),
        "bones": (
            make_window_step(error, low_),
            lambda: first(low_params, low_, jnp.zeros((lanes["bones"], settings.pan_gru))),
            bones_batch,
        ),
        "residual": (
            jax.jit(residual_step, donate_argnums=0),
            lambda: first(high_params, high_),
            residual_batch,
        ),
        "santesteban": (
            make_window_step(santesteban.coefficient_error(deviation, n), pose),
            lambda: first(pose_params, pose, jnp.zeros((lanes["santesteban"], settings.santesteban_gru))),
            pose_batch,
        ),
    }
    return {name: made[name] for name in STAGES if wanted[name]} | {"template": template, "low": low_params}


def shapes_of(knowledge: Knowledge, frames: int = 4096) -> tuple[Any, Callable[[str], Places]]:
    """Return the shapes of some frames and of a stage's places, to compile with."""
    import jax

    known, config = knowledge.known, knowledge.model.config
    n, j = len(knowledge.sources.scene.garment.template), len(knowledge.sources.scene.body.joints)
    from garment_jax.swing.motion import FEATURES

    a, h = config.swing.columns, config.swing.rows
    d = len(knowledge.model.statistics.motion_mean)

    def of(*shape: int, dtype: Any = np.float32) -> Any:
        return jax.ShapeDtypeStruct((frames, *shape), dtype)

    seen = SwingFrame(of(a, FEATURES, dtype=np.float16), of(a, 3), of(), of(a, 3))
    data = Frames(
        seen,
        of(a, h, 3),
        of(d),
        of(j, 3, 3),
        of(j, 3),
        of(*known["bone_mean"].shape),
        of(len(known["deviation"])),
        of(config.generative.latent_dim),
        of(n, 3, dtype=np.float16),
    )

    def places(name: str) -> Places:
        L, W = LANES[name], window_of(name, config)
        flags, whole = np.zeros(L, bool), np.zeros(L, np.int32)
        weights = np.zeros((W, L), np.float32)
        return Places(whole, whole, flags, flags, flags, flags, weights, weights)

    return data, places


def window_of(name: str, config: Any) -> int:
    """Return the frames of a stage's window."""
    return config.swing.window if name == "swing" else config.motion.window


def compiled(knowledge: Knowledge, wanted: dict[str, float], lanes: dict[str, int]) -> None:
    """Compile the steps into jax's cache on disk, in a process beside the simulation."""
    import jax

    LANES.update(lanes)  # a process of its own
    stages = make_stages(knowledge, wanted)
    data, places = shapes_of(knowledge)
    for name in STAGES:
        if name not in stages:
            continue
        began = time.perf_counter()
        step, begin, batch = stages[name]
        more = (stages["low"],) if name == "residual" else ()
        shapes = jax.eval_shape(batch, data, places(name), *more)
        step.lower(begin(), shapes).compile()
        say(f"{name}: compiled, {time.perf_counter() - began:.0f} s")


def on_device(clips: list[Learnt], knowledge: Knowledge, template: Any) -> Frames:
    """Return all clips' frames on the device, their codes with them."""
    import jax
    import jax.numpy as jnp

    from garment_jax.generative.network import encode

    config = knowledge.model.config.generative
    params = jax.tree.map(jnp.asarray, knowledge.model.params["generative"])
    mirror, flip = mirror_permutation(knowledge.sources.scene.garment), jnp.asarray(FLIP, jnp.float32)

    @jax.jit
    def codes(U: jax.Array) -> tuple[jax.Array, jax.Array]:
        U = U.astype(jnp.float32)
        return tuple(
            encode(params, V, template=template, config=config).mean for V in (U, U[:, mirror] * flip)
        )

    def joined(name: str) -> jax.Array:
        return jnp.asarray(np.concatenate([getattr(clip, name) for clip in clips]))

    frames = SwingFrame(
        *(jnp.asarray(np.concatenate(x)) for x in zip(*(c.frames for c in clips), strict=True))
    )
    U = jnp.asarray(np.concatenate([clip.U for clip in clips if clip.U is not None]))
    size = 2048
    pairs = [codes(U[min(s, max(len(U) - size, 0)) :][:size]) for s in range(0, len(U), size)]
    over = (-len(U)) % size if len(U) > size else 0  # the last piece begins earlier, to be of one size
    Z = [jnp.concatenate([*z[:-1], z[-1][over:]]) for z in zip(*pairs, strict=True)]
    ends = np.cumsum([0, *(len(c.U) for c in clips if c.U is not None)])
    spans = list(itertools.pairwise(ends))
    Z_all = jnp.concatenate([z[a:b] for a, b in spans for z in Z])
    names = ("X", "M", "R", "t", "bones", "coefficients")
    return Frames(frames, *map(joined, names), Z_all, U)


def places_at(name: str, clips: list[int], knowledge: Knowledge) -> Callable[[int], Places]:
    """Return window -> places; `clips` are the lengths of clips and mirror images by turns."""
    from garment_jax.data.lanes import frame_weights, make_schedule

    config, lengths = knowledge.model.config, clips
    own = config.swing if name == "swing" else config.motion
    window = window_of(name, config)
    schedule = make_schedule(
        lengths,
        lanes=LANES[name],
        window=window,
        steps=WINDOWS,
        seed=knowledge.sources.seed + STAGES.index(name),
        from_first=own.from_first,
        true_starts=1.0 if name == "swing" else config.motion.true_starts,
        lane_windows=1 if name == "residual" else own.lane_windows,
    )
    first = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    in_U = np.concatenate([[0], np.cumsum(lengths[::2])]).astype(np.int32)

    def at(k: int) -> Places:
        w = schedule[k]
        start = w.start.astype(np.int32)
        knowing = frame_weights(w, window, config.motion.grace)
        unknowing = frame_weights(
            w._replace(true_start=np.zeros_like(w.true_start)), window, config.motion.grace
        )
        return Places(
            first[w.clip] + start,
            in_U[w.clip // 2] + start,
            w.clip % 2 == 1,
            start == 0,
            w.fresh,
            w.true_start,
            knowing,
            unknowing,
        )

    return at
