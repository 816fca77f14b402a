"""A model's swing learnt from clips that are simulated for it, side by side on a GPU, and never written.

    python benchmarks/swing_from_simulation.py MODEL CLIP... --pattern FLAT --cloth KEY=VALUE ... --out MODEL2

Motions are made out of CLIPs' (the training clips but those kept back: cloth is not read) as `garment-jax
simulate --vary` makes them, twelve kinds by turns, one of them as they are; `--clips` of them at most, in
waves of `--at-once`, for `--simulate` seconds. Clips whose cloth bunched or was stretched are left out
(`screening.py`'s limits; penetration and self-intersections are not looked at). Of the others a ring's frames
and cells are kept, with their mirror images, and the stage's own step is taken on them, `swing.steps`
windows. MODEL gives everything else. Each `--set` trains a ring, one after the other: OUT, OUT_2, ... With
`--keep FOLDER` the first clips are written there, to look at. With JAX_COMPILATION_CACHE_DIR the steps are
compiled beside the simulation. Needs the extra `sim`.
"""

import argparse
import json
import multiprocessing
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from garment_jax.body.crossed_motion import cross_motions
from garment_jax.body.mirror import FLIP, mirror_motion
from garment_jax.body.root_frame import heading, to_root
from garment_jax.body.vary import Variation, cut, vary_motion
from garment_jax.config import SwingConfig
from garment_jax.data.sequence import open_sequence
from garment_jax.data.sequence_writer import SequenceWriter
from garment_jax.evaluation.cloth import edge_strain, rest_lengths
from garment_jax.geometry.boundary import hem_vertices
from garment_jax.geometry.symmetry import mirror_permutation
from garment_jax.geometry.topology import unique_edges
from garment_jax.machine import machine
from garment_jax.simulation.screening import SETTLED, ScreenLimits
from garment_jax.structs import Motion, Scene
from garment_jax.swing.motion import SwingFrame, swing_frames
from garment_jax.swing.tables import SwingTables, make_swing_tables

BEGAN = time.perf_counter()
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")  # the simulation needs memory, too
WIDE = Variation(tempo=(0.65, 1.45), legs=(0.75, 1.35))
KINDS = (  # (clips that the motion is made of, variation)
    (3, WIDE._replace(turn=(-100, 100), spins=(0, 0.7))),
    (3, WIDE._replace(turn=(-100, 100), spins=(0, 1.5))),
    (3, Variation(turn=(-100, 100))),
    (3, Variation(turn=(-100, 100), spins=(0, 0.7), kicks=(0, 4))),
    (3, WIDE._replace(turn=(-60, 60), kicks=(0, 2))),
    (1, WIDE._replace(turn=(-120, 120), spins=(0, 0.7))),
    (1, Variation(turn=(-60, 60), kicks=(0, 2))),
    (3, WIDE._replace(turn=(-40, 40))),
    (1, Variation(tempo=(1, 1), legs=(1, 1), turn=(0, 0), begin=(0, 0))),  # as it was danced
    (1, Variation()),
    (3, Variation(turn=(-60, 60), kicks=(2, 6))),
    (1, Variation(turn=(-60, 60), spins=(0, 0.7), kicks=(2, 6))),
)


class Sources(NamedTuple):
    """What every worker knows."""

    scene: Scene
    motions: list[Motion]
    config: SwingConfig
    seed: int
    longest: int


class Packed(NamedTuple):
    """A clip as the ring learns it."""

    frames: SwingFrame  # what is seen in 16 bits: it lies between -6 and 6
    X: np.ndarray


class Training(NamedTuple):
    """A ring's step and what it begins with."""

    step: Callable
    state: Any  # TrainState
    tables: SwingTables


_known: Sources
_tables: SwingTables


def say(text: str) -> None:
    """Print a line with the seconds since the beginning."""
    print(f"{time.perf_counter() - BEGAN:.0f} s: {text}", flush=True)


def begin_worker(sources: Sources) -> None:
    """Set a worker up; it must not take any of the GPU."""
    global _known, _tables
    os.environ["CUDA_VISIBLE_DEVICES"] = ""
    _known, _tables = sources, make_swing_tables(sources.scene, config=sources.config)


def made_motion(k: int) -> Motion:
    """Return the k-th motion."""
    body = _known.scene.body
    rng = np.random.default_rng([_known.seed, k])
    count, variation = KINDS[k % len(KINDS)]
    chosen = rng.choice(len(_known.motions), count, replace=False)
    if count > 1:
        variation = variation._replace(begin=(0.0, 0.0))
    parts = [
        cut(vary_motion(_known.motions[i], body, rng, variation=variation), _known.longest, rng)
        for i in chosen
    ]
    return parts[0] if count == 1 else cross_motions(*parts, body)


def packed(motion: Motion, V: np.ndarray) -> list[Packed]:
    """Return a clip and its mirror image; nothing of one that must not be learnt from."""
    scene, garment = _known.scene, _known.scene.garment
    if not np.isfinite(V).all():
        return []
    edges, limits = unique_edges(garment.faces), ScreenLimits()
    strain = edge_strain(V[::10], edges, rest_lengths(garment.template, edges))
    pins = None if scene.pins is None else scene.pins.vertices
    height = V[:, hem_vertices(garment.template, garment.faces, pins), 1].mean(axis=1) - motion.root[:, 1]
    quarter = max(int(SETTLED * len(height)), 1)
    rise = 100.0 * (np.median(height[-quarter:]) - np.median(height[:quarter]))
    if np.percentile(strain, 99, axis=1).max() > limits.strain_p99_percent or rise > limits.hem_rise_cm:
        return []
    mirror = mirror_permutation(garment)
    both = (motion, V), (mirror_motion(motion, scene.body), V[:, mirror] * FLIP.astype(np.float32))
    return [_as_learnt(motion, V) for motion, V in both]


def _as_learnt(motion: Motion, V: np.ndarray) -> Packed:
    frames, down = swing_frames(motion, _known.scene, _tables), _tables.down
    local = to_root(V, motion.root, heading(motion.rotations[:, 0])).astype(np.float32)
    a, h = _tables.filled.shape
    rows = np.repeat(np.arange(len(down.index)), down.index.shape[1])
    mean = sp.csr_array((down.weight.ravel(), (rows, down.index.ravel())), (a * h, local.shape[1]))
    cells = np.stack([mean @ x for x in local]).reshape(len(V), a, h, 3) - frames.anchor[:, :, None]
    cells = np.einsum("aij,tahj->tahi", _tables.frames, cells).astype(np.float32)
    frames = frames._replace(seen=frames.seen.astype(np.float16))
    return Packed(frames, np.where(_tables.filled[..., None] > 0, cells, _tables.typical))


def simulated(
    known: Any,
    options: argparse.Namespace,
    begin: Callable[[Any], None] = begin_worker,
    pack: Callable[[Motion, np.ndarray], list] = packed,
) -> tuple[list, dict]:
    """Return the clips to learn from, packed by `pack` in workers that `begin` sets up, and what was done."""
    from garment_jax.progress import FrameProgress
    from garment_jax.simulation.command import cloth_settings, read_pattern
    from garment_jax.simulation.newton_cloth import drape
    from garment_jax.simulation.side_by_side import SideBySide

    sources = getattr(known, "sources", known)
    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    kept, seconds, done, frames = [], 0.0, 0, 0
    began = time.perf_counter()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.workers, context, begin, (known,)) as pool:
        motions = [pool.submit(made_motion, k) for k in range(options.clips)]
        draped = drape(sources.scene, settings, flat=flat)
        cloths = SideBySide(sources.scene, settings, flat, options.at_once, options.device)
        packing = []
        while done < options.clips and time.perf_counter() - began < options.simulate:
            wave = [future.result() for future in motions[done : done + options.at_once]]
            start = time.perf_counter()
            with FrameProgress(f"clips {done + 1} to {done + len(wave)}") as progress:
                V = cloths.simulate(wave, drape=draped, progress=progress)
            seconds += time.perf_counter() - start
            packing += [pool.submit(pack, *clip) for clip in zip(wave, V, strict=True)]
            if options.keep and not done:
                _write(sources.scene, wave, V, options.keep)
            done, frames = done + len(wave), frames + sum(map(len, V))
            say(f"{done} clips, {frames} frames, {seconds:.0f} s of the simulation")
        for future in motions[done:]:
            future.cancel()
        for future in packing:
            kept += future.result()
    facts = {
        "clips": done,
        "frames": frames,
        "kept": len(kept) // 2,
        "kept_frames": sum(len(clip.X) for clip in kept) // 2,
        "simulation_seconds": seconds,
        "all_seconds": time.perf_counter() - began,
        "at_once": options.at_once,
        "device": cloths.device_name,
    }
    say(str(facts))
    return kept, facts


def _write(scene: Scene, motions: list[Motion], cloths: list[np.ndarray], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k, (motion, V) in enumerate(zip(motions[: len(KINDS)], cloths, strict=False)):
        if not np.isfinite(V).all():
            continue
        with SequenceWriter(folder / f"made_{k}.h5", scene, motion, encoding="float32") as writer:
            writer.append(V)


def training(config: SwingConfig, sources: Sources) -> Training:
    """Return what a ring is trained with."""
    import jax
    import jax.numpy as jnp

    from garment_jax.config import TrainingConfig
    from garment_jax.structs import TrainState
    from garment_jax.swing.network import at_rest, init_swing
    from garment_jax.swing.train_step import make_swing_train_step
    from garment_jax.training.optimiser import make_optimiser

    tables = make_swing_tables(sources.scene, config=config)
    optimiser = make_optimiser(
        TrainingConfig(),
        learning_rate=config.learning_rate,
        weight_decay=config.weight_decay,
        steps=config.steps,
    )
    params = init_swing(jax.random.key(sources.seed), config=config)
    carry = jax.tree.map(jnp.array, at_rest(tables, (config.lanes,), config=config))
    state = TrainState(params, optimiser.init(params), jax.random.key(1), jnp.int32(0), carry)
    return Training(make_swing_train_step(tables, config, optimiser), state, tables)


def compiled(configs: list[SwingConfig], sources: Sources) -> None:
    """Compile the steps into jax's cache on disk, in a process beside the simulation."""
    import jax

    from garment_jax.swing.motion import FEATURES
    from garment_jax.swing.train_step import SwingBatch

    for config in configs:
        step, state, tables = training(config, sources)
        (a, h), lanes, window = tables.filled.shape, config.lanes, config.window
        shapes = (
            SwingFrame(
                (window, lanes, a, FEATURES), (window, lanes, a, 3), (window, lanes), (window, lanes, a, 3)
            ),
            (window, lanes, a, h, 3),
            (lanes, a, h, 3),
        )
        frames, X, start = jax.tree.map(
            lambda shape: jax.ShapeDtypeStruct(shape, np.float32),
            shapes,
            is_leaf=lambda x: type(x) is tuple and isinstance(x[0], int),
        )
        flags = jax.ShapeDtypeStruct((lanes,), np.bool_)
        began = time.perf_counter()
        step.lower(state, SwingBatch(frames, X, flags, start, flags)).compile()
        say(f"a step is compiled, {time.perf_counter() - began:.0f} s")


def on_device(clips: list[Packed]) -> tuple[SwingFrame, Any]:
    """Return all clips' frames and cells, one after the other."""
    import jax.numpy as jnp

    frames = (jnp.asarray(np.concatenate(x)) for x in zip(*(c.frames for c in clips), strict=True))
    return SwingFrame(*frames), jnp.asarray(np.concatenate([clip.X for clip in clips]))


def train(
    data: tuple[SwingFrame, Any],
    lengths: list[int],
    config: SwingConfig,
    sources: Sources,
    save: Callable[[dict, int], None],
) -> None:
    """Train a ring on the clips, `config.steps` windows; `save` takes its parameters twenty times."""
    import jax
    import jax.numpy as jnp

    from garment_jax.data.lanes import make_schedule
    from garment_jax.swing.train_step import SwingBatch

    step, state, tables = training(config, sources)
    first = np.concatenate([[0], np.cumsum(lengths)])

    @jax.jit
    def batch(frames, X, at, begins, fresh):
        which = at[None] + jnp.arange(config.window)[:, None]
        start = jnp.where(begins[:, None, None, None], tables.rest, X[jnp.maximum(at - 1, 0)])
        cut = SwingFrame(*(leaf[which].astype(jnp.float32) for leaf in frames))
        return SwingBatch(cut, X[which], fresh, start, fresh & ~begins)

    schedule = make_schedule(
        lengths,
        lanes=config.lanes,
        window=config.window,
        steps=config.steps,
        seed=sources.seed + 40,
        from_first=config.from_first,
        true_starts=1.0,
        lane_windows=config.lane_windows,
    )
    say(f"training, {config.layers} layers, {first[-1]} frames with mirror images")
    show, rmse = max(config.steps // 20, 1), []
    began = time.perf_counter()
    for k, w in enumerate(schedule, start=1):
        places = map(jnp.asarray, (first[w.clip] + w.start, w.start == 0, w.fresh))
        state, metrics = step(state, batch(*data, *places))
        rmse.append(metrics["rmse_cm"])
        if k == 1:
            jax.block_until_ready(state)
            say("the first window is done")
        if k % show == 0 or k == config.steps:
            done = float(jnp.stack(rmse[-show:]).mean())
            say(f"{k}/{config.steps} windows, {done:.3f} cm, {time.perf_counter() - began:.0f} s")
            save(jax.device_get(state.params), k)  # a machine that is lent may be gone before the end


def add_simulation(parser: argparse.ArgumentParser) -> None:
    """Add what says how clips are made and simulated, and where the result goes."""
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--pattern", type=Path)
    parser.add_argument("--cloth", nargs="*", default=[])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--at-once", type=int, default=128)
    parser.add_argument("--clips", type=int, default=1280)
    parser.add_argument("--longest", type=int, default=350)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--simulate", type=float, default=np.inf, help="seconds")
    parser.add_argument("--seed", type=int, default=811)
    parser.add_argument("--keep", type=Path)


def read_sources(options: argparse.Namespace, config: SwingConfig) -> Sources:
    """Return the motions that clips are made out of, and their scene, the first clip's."""
    motions, scene = [], None
    for path in options.sources:
        with open_sequence(path) as clip:
            scene = scene or clip.scene
            motions.append(clip.motion)
    assert scene is not None
    return Sources(scene, motions, config, options.seed, options.longest)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("sources", nargs="+", type=Path, metavar="clip")
    add_simulation(parser)
    parser.add_argument("--set", nargs="+", action="append", metavar="KEY=VALUE", help="of [swing]")
    options = parser.parse_args()

    from garment_jax.config import apply_overrides
    from garment_jax.rollout.model import save_model
    from garment_jax.swing.tables import seen_body
    from garment_jax.training.pipeline import trained_model

    model = trained_model(options.model)
    rings = [
        apply_overrides(model.config, [f"--swing.{pair}" for pair in pairs]) for pairs in options.set or [[]]
    ]
    sources = read_sources(options, rings[0].swing)
    scene = sources.scene
    cells = {(ring.swing.columns, ring.swing.rows) for ring in rings}
    if len(cells) > 1:
        parser.error(f"rings of one call see the same cells; {cells} (columns, rows) need a call each.")
    aside = None
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        steps = [ring.swing for ring in rings]
        aside = multiprocessing.get_context("spawn").Process(target=compiled, args=(steps, sources))
        aside.start()
    clips, facts = simulated(sources, options)
    lengths = [len(clip.X) for clip in clips]
    data = on_device(clips)
    del clips
    if aside is not None:
        aside.join()
    for k, ring in enumerate(rings, start=1):
        out = options.out if k == 1 else options.out.with_name(f"{options.out.name}_{k}")

        def save(params: dict, windows: int, ring=ring, out=out) -> None:
            config = replace(ring, swing=replace(ring.swing, steps=windows))
            whole = {**model.params, "swing": params}
            save_model(model._replace(config=config, params=whole, seen=seen_body(scene)), out)

        train(data, lengths, ring.swing, sources, save)
        say(json.dumps(machine() | facts | {"windows": ring.swing.steps, "lanes": ring.swing.lanes}))


if __name__ == "__main__":
    main()
