"""Our codes and swing, Pan's and Santesteban's networks, all learnt from the same simulated frames on a GPU.

    python benchmarks/equal_frames.py known MODEL DATA --out KNOWN
    python benchmarks/equal_frames.py train MODEL CLIP... --known KNOWN --pattern FLAT --cloth ... --out OUT

`known` takes from DATA's training clips what does not hang on the frames to come: Pan's bones, Santesteban's
components, our linearised garment. `train` makes clips out of CLIPs' motions and simulates them as
`swing_from_simulation.py` does (its options; nothing is written but with `--keep`), and then trains, each for
its `--seconds`: our motion encoder (`warm_up`, then `codes` through the decoders), our ring (`swing`), Pan's
two networks (`bones`, `residual`), Santesteban's. Ours go on from MODEL, whose generative model stays; the
others begin anew. Every learning rate falls to 1 % in its seconds; `--set` changes MODEL's configuration.
OUT/ours is a saved model; OUT/pan/model and OUT/santesteban/model are what the baselines load. With
JAX_COMPILATION_CACHE_DIR the steps are compiled beside the simulation. Needs the extra `sim`.
"""

import argparse
import itertools
import json
import multiprocessing
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import swing_from_simulation as clips_of
from measured import machine
from swing_from_simulation import Sources, say

from garment_jax.baselines.bones import as_numbers, bone_transforms, bones_of
from garment_jax.body.garment_skinning import closest_weights, garment_transforms, joint_transforms
from garment_jax.body.mirror import FLIP, mirror_motion
from garment_jax.body.motion_features import chosen_joints, motion_features
from garment_jax.body.root_frame import heading, to_root
from garment_jax.data.template import canonical_weights
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.structs import FrameInput, Motion, TrainState
from garment_jax.swing.motion import SwingFrame

STAGES = ("warm_up", "codes", "swing", "bones", "residual", "santesteban")
SECONDS = {"warm_up": 80, "codes": 70, "swing": 90, "bones": 60, "residual": 25, "santesteban": 60}
RATES = {
    "warm_up": 1e-3,
    "codes": 2e-4,
    "swing": 5e-4,
    "bones": 3e-3,
    "residual": 1.5e-3,
    "santesteban": 3e-3,
}  # the baselines': their search's in docs/results.md
LANES = {"warm_up": 256, "codes": 64, "swing": 256, "bones": 256, "residual": 64, "santesteban": 256}
WINDOWS = 6_000  # of each stage, again and again
SAVES = 6  # while a stage is trained
FLOOR = 0.01  # of a learning rate, at the end
RISE = 0.02  # of the seconds


class Learnt(NamedTuple):
    """A clip, or its mirror image, as all networks learn it; begins as `swing_from_simulation.Packed`."""

    frames: SwingFrame
    X: np.ndarray
    M: np.ndarray  # [t, d] features
    R: np.ndarray  # [t, j, 3, 3] what poses a canonical garment
    t: np.ndarray  # [t, j, 3]
    bones: np.ndarray  # [t, b, 6]
    coefficients: np.ndarray  # [t, k] of Santesteban's displacements
    U: np.ndarray | None  # [t, n, 3] canonical, 16 bits; None: the clip's before it, mirrored


class Knowledge(NamedTuple):
    """Sources with what `known` wrote."""

    sources: Sources
    model: Any
    known: dict[str, np.ndarray]


_all: Knowledge
_fixed: tuple[np.ndarray, ...]  # canonical weights, Santesteban's, joints


def begin_worker(knowledge: Knowledge) -> None:
    """Set a worker up."""
    global _all, _fixed
    import jax

    jax.config.update("jax_platforms", "cpu")  # must not take any of the GPU
    clips_of.begin_worker(knowledge.sources)
    scene, config = knowledge.sources.scene, knowledge.model.config
    joints = chosen_joints(scene.body, config.body.motion_joints)
    W = canonical_weights(scene, config)
    assert W is not None
    _all, _fixed = knowledge, (W, closest_weights(scene), joints)


def packed(motion: Motion, V: np.ndarray) -> list[Learnt]:
    """Return a clip and its mirror image; nothing of one that must not be learnt from."""
    rings = clips_of.packed(motion, V)
    if not rings:
        return []
    scene = _all.sources.scene
    other = (
        mirror_motion(motion, scene.body),
        V[:, mirror_permutation(scene.garment)] * FLIP.astype(np.float32),
    )
    return [
        _learnt(ring, *clip, first=i == 0)
        for i, (ring, clip) in enumerate(zip(rings, ((motion, V), other), strict=True))
    ]


def _learnt(ring: clips_of.Packed, motion: Motion, V: np.ndarray, *, first: bool) -> Learnt:
    scene, known = _all.sources.scene, _all.known
    W, closest, joints = _fixed
    T = (scene.garment.template.astype(np.float64) - scene.body.joints[0]).astype(np.float32)
    local = to_root(V, motion.root, heading(motion.rotations[:, 0])).astype(np.float32)
    R, t = garment_transforms(motion, scene)
    weights = known["bones"]
    numbers = as_numbers(*bone_transforms(T, local, weights), bones_of(T, weights).centres)
    offset = _unskinned(local, closest, *joint_transforms(motion, scene)) - T
    flat = offset.reshape(len(offset), -1) - known["mean"]
    U = _unskinned(local, W, R, t).astype(np.float16) if first else None
    M = motion_features(motion, scene.body, joints)
    basis = known["basis"].astype(np.float32)
    return Learnt(*ring, M, R, t, numbers, flat @ basis.T, U)


def _unskinned(V: np.ndarray, W: np.ndarray, R: np.ndarray, t: np.ndarray, chunk: int = 64) -> np.ndarray:
    from garment_jax.geometry.skinning import unskin_frames

    out = np.zeros_like(V)
    for start in range(0, len(V), chunk):
        which = np.minimum(np.arange(start, start + chunk), len(V) - 1)  # one compiled length
        stop = min(start + chunk, len(V))
        out[start:stop] = np.asarray(unskin_frames(V[which], W, R[which], t[which]))[: stop - start]
    return out


def find_known(model_path: Path, data: Path, out: Path) -> None:
    """Write what `train` takes as given."""
    import tempfile

    from garment_jax.baselines import santesteban
    from garment_jax.baselines.bones import find_bones
    from garment_jax.baselines.fitting import open_baseline
    from garment_jax.baselines.pan_targets import bone_targets
    from garment_jax.training.codes import true_codes
    from garment_jax.training.motion_stage import linear_garment
    from garment_jax.training.pipeline import trained_model

    model = trained_model(model_path)
    with (
        tempfile.TemporaryDirectory() as folder,
        open_baseline("pan_2022", ("pan",), model.config, Path(folder) / "a", data) as run,
    ):
        bones = find_bones(run)
        numbers = np.concatenate(bone_targets(run, bones))
        components, c = santesteban._targets(run, closest_weights(run.data.scene))
        run = run._replace(config=model.config, folder=Path(folder) / "b")
        (Path(folder) / "b" / "cache").mkdir(parents=True)
        template = _template(model, run.data.scene)
        W = canonical_weights(run.data.scene, model.config)
        trained = [
            clip._replace(U=_unskinned(np.asarray(clip.V), W, clip.input.x.R, clip.input.x.t))
            for clip in run.data.train
            if not clip.mirrored
        ]
        run = run._replace(template=template, data=run.data._replace(train=trained))
        linear = linear_garment(run, true_codes(run, model.params["generative"]))
    arrays = {
        "bones": bones.weights,
        "bone_mean": numbers.mean(axis=0),
        "bone_deviation": np.maximum(numbers.std(axis=0), 1e-4),
        "mean": components.mean,
        "basis": components.basis.astype(np.float16),
        "deviation": np.maximum(np.concatenate(c).std(axis=0), 1e-6),
        **linear._asdict(),
    }
    np.savez_compressed(out, **arrays)
    print({name: array.shape for name, array in arrays.items()})


def _template(model: Any, scene: Any) -> Any:
    from garment_jax.rollout.model import template_for

    return template_for(model, scene, "the clips")[0]


def optimiser_of(weight_decay: float) -> Any:
    """Return AdamW, clipped to a norm of 1, with a learning rate that is set from outside."""
    import optax

    adam = optax.inject_hyperparams(optax.adamw)(learning_rate=0.0, weight_decay=weight_decay)
    return optax.chain(optax.clip_by_global_norm(1.0), adam)


def timed(
    name: str,
    step: Callable,
    state: TrainState,
    batch_at: Callable[[int], Any],
    seconds: float,
    save: Callable[[TrainState], None],  # a machine that is lent may be gone before the end
) -> TrainState:
    """Return the state after as many steps as go into `seconds`."""
    import jax
    import jax.numpy as jnp

    rate, k, rmse, saved = RATES[name], 0, [], 1
    state, metrics = step(state, batch_at(0))
    jax.block_until_ready(state)
    began = time.perf_counter()
    while True:
        part = (time.perf_counter() - began) / seconds
        if part >= 1.0:
            break
        falling = FLOOR + (1.0 - FLOOR) * 0.5 * (1.0 + np.cos(np.pi * part))
        now = jnp.float32(rate * min(part / RISE + 1e-2, falling))
        state.opt_state[1].hyperparams["learning_rate"] = now
        k += 1
        state, metrics = step(state, batch_at(k % WINDOWS))
        rmse.append(metrics["rmse_cm"])
        if k % 20 == 0:
            jax.block_until_ready(rmse[-1])
        if part > saved / SAVES or k == 20:
            saved += part > saved / SAVES
            done = time.perf_counter() - began
            say(f"{name}: {k} windows, {float(jnp.stack(rmse[-200:]).mean()):.3f} cm, {done:.0f} s")
            if k > 20:
                save(state)
    mean = float(jnp.stack(rmse[-200:]).mean()) if rmse else np.nan
    say(f"{name}: {k} windows in all, {mean:.3f} cm, {1e3 * seconds / max(k, 1):.1f} ms each")
    save(state)
    return state


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
    template = _template(model, scene)._replace(ring=None)
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


def seconds_of(pairs: list[str]) -> dict[str, float]:
    """Return the seconds of each stage; raises `ValueError` for one that is not there or lacks another."""
    given = dict(pair.split("=") for pair in pairs)
    for name in given:
        if name not in STAGES:
            raise ValueError(f"--seconds {name} is no stage; choose from {', '.join(STAGES)}.")
    wanted = SECONDS | {name: float(value) for name, value in given.items()}
    if wanted["residual"] and not wanted["bones"]:
        raise ValueError("--seconds bones=0 leaves the residual nothing to correct; give residual=0, too.")
    return wanted


def train(knowledge: Knowledge, options: argparse.Namespace) -> None:
    """Simulate, train all that is wanted, save."""
    import jax

    from garment_jax.baselines.fitting import own_config
    from garment_jax.rollout.model import Model, save_model
    from garment_jax.swing.tables import seen_body

    wanted = seconds_of(options.seconds)
    aside = None
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        context = multiprocessing.get_context("spawn")
        aside = context.Process(target=compiled, args=(knowledge, wanted, LANES))
        aside.start()
    clips, facts = clips_of.simulated(knowledge, options, begin_worker, packed)
    stages = make_stages(knowledge, wanted)
    lengths = [len(clip.X) for clip in clips]
    data = on_device(clips, knowledge, stages["template"])
    jax.block_until_ready(data)
    del clips
    say(f"{sum(lengths)} frames with mirror images on the device")
    if aside is not None:
        aside.join()
    model, known, scene = knowledge.model, knowledge.known, knowledge.sources.scene
    ours, done = dict(model.params), {}

    def save(name: str, state: TrainState) -> None:
        done[name] = jax.device_get(state.params)
        config = own_config(model.config)
        if name in ("warm_up", "codes", "swing"):
            ours["motion" if name != "swing" else name] = done[name]
            save_model(model._replace(params=ours, seen=seen_body(scene)), options.out / "ours")
            return
        if name == "santesteban":
            fixed = {"basis": known["basis"].astype(np.float32), "mean": known["mean"]}
            fixed |= {"deviation": known["deviation"], "weights": closest_weights(scene)}
            params = {"network": done[name], **fixed}
        else:
            params = {"low": done["bones"], "weights": known["bones"], "mean": known["bone_mean"]}
            params |= {"deviation": known["bone_deviation"]}
            params |= {"high": done["residual"]} if "residual" in done else {}
        folder = options.out / {"bones": "pan", "residual": "pan"}.get(name, name) / "model"
        folder.parent.mkdir(parents=True, exist_ok=True)
        other = Model(config, params, model.statistics, model.garment_hash, model.vertices, model.fps)
        save_model(other, folder, bits=32)

    for name in STAGES:
        if name not in stages:
            continue
        step, begin, batch = stages[name]
        state = begin()
        if name == "codes" and "warm_up" in done:
            params = jax.tree.map(jax.numpy.array, done["warm_up"])
            state = state._replace(params=params)
        make, places = jax.jit(batch), places_at(name, lengths, knowledge)
        more = (done.get("bones", stages["low"]),) if name == "residual" else ()

        def batch_at(k: int, make=make, places=places, more=more) -> Any:
            return make(data, places(k), *more)

        timed(name, step, state, batch_at, wanted[name], partial(save, name))
    say(json.dumps(machine() | facts | {"seconds": wanted, "lanes": LANES, "rates": RATES}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    find = commands.add_parser("known")
    find.add_argument("model", type=Path)
    find.add_argument("data", type=Path)
    find.add_argument("--out", type=Path, required=True)
    go = commands.add_parser("train")
    go.add_argument("model", type=Path)
    go.add_argument("sources", nargs="+", type=Path, metavar="clip")
    go.add_argument("--known", type=Path, required=True)
    go.add_argument("--seconds", nargs="*", default=[], metavar="STAGE=SECONDS")
    go.add_argument("--lanes", type=int, help="of every stage")
    go.add_argument("--set", nargs="*", default=[], metavar="SECTION.KEY=VALUE", help="of the model's config")
    clips_of.add_simulation(go)
    options = parser.parse_args()
    if options.command == "known":
        find_known(options.model, options.data, options.out)
        return
    from garment_jax.config import apply_overrides
    from garment_jax.training.pipeline import trained_model

    if options.lanes:
        LANES.update(dict.fromkeys(LANES, options.lanes))
    model = trained_model(options.model)
    model = model._replace(config=apply_overrides(model.config, [f"--{pair}" for pair in options.set]))
    sources = clips_of.read_sources(options, model.config.swing)
    with np.load(options.known) as stored:
        known = {name: stored[name] for name in stored.files}
    train(Knowledge(sources, model, known), options)


if __name__ == "__main__":
    main()
