"""A model's swing learnt from clips that are simulated for it, side by side on a GPU, and never written.

    python benchmarks/swing_from_simulation.py MODEL CLIP... --pattern FLAT --cloth KEY=VALUE ... --out MODEL2

Motions are made out of CLIPs' (the training clips but those kept back: cloth is not read) as `garment-jax
simulate --vary` makes them, eight kinds by turns; `--clips` of them at most, in waves of `--at-once`, for
`--simulate` seconds. Clips whose cloth bunched or was stretched are left out (`screening.py`'s limits;
penetration and self-intersections are not looked at). Of the others a ring's frames and cells are kept, with
their mirror images, and the stage's own step is taken on them, `swing.steps` windows. MODEL gives everything
else. With `--keep FOLDER` the first clips are written there, to look at. Needs the extra `sim`.
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
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from measured import machine

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
from garment_jax.simulation.screening import SETTLED, ScreenLimits
from garment_jax.structs import Motion, Scene
from garment_jax.swing.motion import SwingFrame, swing_frames
from garment_jax.swing.tables import SwingTables, make_swing_tables

BEGAN = time.perf_counter()
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

    frames: SwingFrame
    X: np.ndarray


_known: Sources
_tables: SwingTables


def say(text: str) -> None:
    """Print a line with the seconds since the beginning."""
    print(f"{time.perf_counter() - BEGAN:.0f} s: {text}", flush=True)


def _begin(sources: Sources) -> None:
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
    return [_as_learnt(*one) for one in both]


def _as_learnt(motion: Motion, V: np.ndarray) -> Packed:
    frames, down = swing_frames(motion, _known.scene, _tables), _tables.down
    local = to_root(V, motion.root, heading(motion.rotations[:, 0])).astype(np.float32)
    a, h = _tables.filled.shape
    rows = np.repeat(np.arange(len(down.index)), down.index.shape[1])
    mean = sp.csr_array((down.weight.ravel(), (rows, down.index.ravel())), (a * h, local.shape[1]))
    cells = np.stack([mean @ x for x in local]).reshape(len(V), a, h, 3) - frames.anchor[:, :, None]
    cells = np.einsum("aij,tahj->tahi", _tables.frames, cells).astype(np.float32)
    return Packed(frames, np.where(_tables.filled[..., None] > 0, cells, _tables.typical))


def simulated(sources: Sources, options: argparse.Namespace) -> tuple[list[Packed], dict]:
    """Return the clips to learn from, and what was done to have them."""
    from garment_jax.progress import FrameProgress
    from garment_jax.simulation.command import cloth_settings, read_pattern
    from garment_jax.simulation.newton_cloth import drape
    from garment_jax.simulation.side_by_side import SideBySide

    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    kept, seconds, done, frames = [], 0.0, 0, 0
    began = time.perf_counter()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.workers, context, _begin, (sources,)) as pool:
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
            packing += [pool.submit(packed, *clip) for clip in zip(wave, V, strict=True)]
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


def train(clips: list[Packed], sources: Sources, save: Callable[[dict, int], None]) -> None:
    """Train a ring on the clips, `swing.steps` windows; `save` takes its parameters twenty times."""
    import jax
    import jax.numpy as jnp

    from garment_jax.config import TrainingConfig
    from garment_jax.data.lanes import make_schedule
    from garment_jax.structs import TrainState
    from garment_jax.swing.network import at_rest, init_swing
    from garment_jax.swing.train_step import SwingBatch, make_swing_train_step
    from garment_jax.training.optimiser import make_optimiser

    config, tables = sources.config, make_swing_tables(sources.scene, config=sources.config)
    lengths = [len(clip.X) for clip in clips]
    first = np.concatenate([[0], np.cumsum(lengths)])
    frames = SwingFrame(
        *(jnp.asarray(np.concatenate(x)) for x in zip(*(c.frames for c in clips), strict=True))
    )
    X = jnp.asarray(np.concatenate([clip.X for clip in clips]))

    @jax.jit
    def batch(at, begins, fresh):
        which = at[None] + jnp.arange(config.window)[:, None]
        start = jnp.where(begins[:, None, None, None], tables.rest, X[jnp.maximum(at - 1, 0)])
        cut = SwingFrame(*(leaf[which] for leaf in frames))
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
    say(f"{len(X)} frames with mirror images are on the device")
    optimiser = make_optimiser(
        TrainingConfig(),
        learning_rate=config.learning_rate,
        weight_decay=config.weight_decay,
        steps=config.steps,
    )
    params = init_swing(jax.random.key(sources.seed), config=config)
    carry = jax.tree.map(jnp.array, at_rest(tables, (config.lanes,), config=config))
    state = TrainState(params, optimiser.init(params), jax.random.key(1), jnp.int32(0), carry)
    step, show, rmse = make_swing_train_step(tables, config, optimiser), max(config.steps // 20, 1), []
    began = time.perf_counter()
    for k, w in enumerate(schedule, start=1):
        state, metrics = step(
            state, batch(*map(jnp.asarray, (first[w.clip] + w.start, w.start == 0, w.fresh)))
        )
        rmse.append(metrics["rmse_cm"])
        if k % show == 0 or k == config.steps:
            done = float(jnp.stack(rmse[-show:]).mean())
            say(f"{k}/{config.steps} windows, {done:.3f} cm, {time.perf_counter() - began:.0f} s")
            save(jax.device_get(state.params), k)  # a machine that is lent may be gone before the end


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("sources", nargs="+", type=Path, metavar="clip")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--pattern", type=Path)
    parser.add_argument("--cloth", nargs="*", default=[])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--at-once", type=int, default=128)
    parser.add_argument("--clips", type=int, default=1280)
    parser.add_argument("--longest", type=int, default=350)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--simulate", type=float, default=np.inf, help="seconds")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="of [swing]")
    parser.add_argument("--seed", type=int, default=811)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()

    from garment_jax.config import apply_overrides
    from garment_jax.rollout.model import save_model
    from garment_jax.swing.tables import seen_body
    from garment_jax.training.pipeline import trained_model

    model = trained_model(options.model)
    config = apply_overrides(model.config, [f"--swing.{pair}" for pair in options.set])
    motions, scene = [], None
    for path in options.sources:
        with open_sequence(path) as clip:
            scene = scene or clip.scene
            motions.append(clip.motion)
    assert scene is not None
    sources = Sources(scene, motions, config.swing, options.seed, options.longest)
    clips, facts = simulated(sources, options)

    def save(params: dict, windows: int) -> None:
        now = replace(config, swing=replace(config.swing, steps=windows))
        save_model(
            model._replace(config=now, params={**model.params, "swing": params}, seen=seen_body(scene)),
            options.out,
        )

    train(clips, sources, save)
    say(json.dumps(machine() | facts | {"windows": config.swing.steps, "lanes": config.swing.lanes}))


if __name__ == "__main__":
    main()
