"""What each kind of scene can leave out: time and error before and after (`docs/scenes.md`).

    python benchmarks/scenes.py models/skirt CLIP [--memoryless RUN] [--only NAME...] [--json FILE]

CLIP is one that the model has not seen. Times are medians over chunks of milliseconds a frame, single stream,
start not counted, or seconds for the whole task where the task is one frame. Errors are RMSE against the
clip's truth, or against the rollout that leaves nothing out. `--memoryless` is a run of train.py on the same
stage 1 with `--motion.previous_state false`.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np

from garment_jax.animation import rollout_many, template_for
from garment_jax.animation.animate import Animator, make_animator
from garment_jax.animation.plan import make_plan
from garment_jax.bench.figures import report
from garment_jax.dataset.start import make_start
from garment_jax.evaluation.rmse import rmse
from garment_jax.io.sequence import open_sequence
from garment_jax.model.compose import init_state
from garment_jax.model.scan import make_rollout
from garment_jax.model.store import Model, facts_of, load_model, model_input
from garment_jax.structs import Collider, Motion, Scene
from garment_jax.training.pipeline import trained_model

SETTLE = 90  # frames before a single frame, or before a pose
LANES, MOTIONS, FRAMES = 16, 64, 64


class Clip:
    """The clip in memory: scene, motion, truth."""

    def __init__(self, path: Path, frames: int) -> None:
        with open_sequence(path) as sequence:
            self.scene, count = sequence.scene, min(frames, sequence.frames)
            self.motion = part(sequence.motion, 0, count)
            self.V = sequence.read(0, count)


def part(motion: Motion, start: int, stop: int) -> Motion:
    return Motion(motion.rotations[start:stop], motion.root[start:stop], motion.fps)


def rolled(run: Animator, motion: Motion, **options) -> tuple[np.ndarray, float]:
    """Return the garment and the median milliseconds a frame, the first chunk not counted."""
    pieces, times, began = [], [], time.perf_counter()
    for piece in run(motion, **options):
        times.append((time.perf_counter() - began) / len(piece.V))
        pieces.append(piece.V)
        began = time.perf_counter()
    return np.concatenate(pieces), 1e3 * float(np.median(times[1:] or times))


def timed(task: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    """Return a task's answer and its seconds, compiled before."""
    task()
    began = time.perf_counter()
    return task(), time.perf_counter() - began


def row(scene: str, left_out: str, before: float, after: float, unit: str, errors: tuple, of: str) -> dict:
    """Return a line of the table; errors in cm, before and after."""
    return {
        "scene": scene,
        "left out": left_out,
        "before": before,
        "after": after,
        "unit": unit,
        "error before cm": errors[0],
        "error after cm": errors[1],
        "error of": of,
    }


def tight(model: Model, clip: Clip, memoryless: Model) -> dict:
    """The previous state, which cloth that cannot swing does not need."""
    (V, ms), (W, less) = (
        rolled(make_animator(m, clip.scene, detail=False, collision=False), clip.motion)
        for m in (model, memoryless)
    )
    errors = (rmse(V, clip.V), rmse(W, clip.V))
    return row("tight garment", "previous state", ms, less, "ms/frame", errors, "truth")


def static_pose(model: Model, clip: Clip) -> dict:
    """A held pose: some frames from the canonical pose to it and one in it, not ten seconds of waiting."""
    run = make_animator(model, clip.scene, collision=False)
    pose = part(clip.motion, 100, 101)
    held = Motion(pose.rotations.repeat(300, axis=0), pose.root.repeat(300, axis=0), pose.fps)
    V, seconds = timed(lambda: rolled(run, held, preroll=SETTLE)[0][-1])
    W, less = timed(lambda: rolled(run, pose, preroll=SETTLE)[0][-1])
    errors = (0.0, rmse(W, V))
    return row("static pose", f"all but {SETTLE} frames into it", seconds, less, "s", errors, "held for 10 s")


def no_contact(model: Model, clip: Clip) -> dict:
    """A collider that the cloth cannot reach: here the body's own, three metres above."""
    scene = lifted(clip.scene, 3.0)
    plan = make_plan(facts_of(model), scene, clip.motion)
    assert plan.out_of_reach, plan.why["collision"]
    V, ms = rolled(make_animator(model, scene), clip.motion)
    W, less = rolled(make_animator(model, scene, out_of_reach=True), clip.motion)
    errors = (0.0, rmse(W, V))
    return row("body without contact", "collision", ms, less, "ms/frame", errors, "with collision")


def lifted(scene: Scene, up: float) -> Scene:
    """Return the scene with its collider's surface moved up and carried by the root."""
    body, collider = scene.body, scene.collider
    assert collider is not None
    cap = body.vertices[collider.cap_loop].mean(axis=0, keepdims=True)
    own = [body.vertices[collider.body_vertices], *([cap] if len(collider.cap_loop) else [])]
    moved = np.concatenate(own) + np.array([0.0, up, 0.0])
    rigid = np.tile(np.eye(body.skin_weights.shape[1], dtype=np.float32)[0], (len(moved), 1))
    vertices = np.concatenate([body.vertices, moved]).astype(np.float32)
    body = body._replace(vertices=vertices, skin_weights=np.concatenate([body.skin_weights, rigid]))
    added = np.arange(len(vertices) - len(moved), len(vertices))
    used = np.concatenate([collider.body_vertices, added]).astype(np.int32)
    faces = (collider.faces + len(collider.body_vertices)).astype(np.int32)
    return scene._replace(body=body, collider=Collider(used, collider.cap_loop[:0], faces))


def no_detail(model: Model, clip: Clip) -> dict:
    """Detail, for a garment that is small on the screen."""
    (V, ms), (W, less) = (
        rolled(make_animator(model, clip.scene, detail=fine, collision=False), clip.motion)
        for fine in (True, False)
    )
    errors = (rmse(V, clip.V), rmse(W, clip.V))
    return row("without detail", "detail", ms, less, "ms/frame", errors, "truth")


def single_frame(model: Model, clip: Clip) -> dict:
    """One frame of a long motion: begin shortly before it."""
    run, last = make_animator(model, clip.scene, collision=False), len(clip.motion.root)
    V, seconds = timed(lambda: rolled(run, clip.motion)[0][-1])
    short = part(clip.motion, last - 1 - SETTLE, last)
    W, less = timed(lambda: rolled(run, short)[0][-1])
    errors = (rmse(V, clip.V[-1]), rmse(W, clip.V[-1]))
    return row("single frame", f"all but {SETTLE} frames before", seconds, less, "s", errors, "truth")


def many_motions(model: Model, clip: Clip) -> dict:
    """Many motions: lanes side by side, one program for any number of them."""
    template, seeds = template_for(model, clip.scene, "the clip")
    chunk = model.config.rollout.chunk
    starts = [(7 * k) % (len(clip.motion.root) - FRAMES) for k in range(MOTIONS)]
    motions = [
        model_input(model, clip.scene, template, seeds, part(clip.motion, s, s + FRAMES)) for s in starts
    ]
    begin = make_start(template, seeds, model.config.body.tau)
    V_start = begin(*(np.concatenate(x) for x in zip(*((m.R_seed, m.t_seed) for m in motions), strict=True)))
    state = init_state(model.params, V_start, template=template, config=model.config)
    run = make_rollout(template, model.config, detail=False)

    def with_lanes(lanes: int) -> np.ndarray:
        made = rollout_many(run, model.params, state, [m.x for m in motions], chunk=chunk, lanes=lanes)
        return np.stack([V for _, V in sorted(made, key=lambda pair: pair[0])])

    V, seconds = timed(lambda: with_lanes(1))
    W, less = timed(lambda: with_lanes(LANES))
    per_frame = 1e3 / (MOTIONS * FRAMES)
    errors = (0.0, rmse(W, V))
    name = f"{MOTIONS} motions"
    return row(
        name, f"{LANES} lanes", per_frame * seconds, per_frame * less, "ms/frame", errors, "one by one"
    )


def main() -> None:
    """Measure the scenes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--memoryless", help="run without the previous state")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--cache", help="folder for compiled programs")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.cache:
        jax.config.update("jax_compilation_cache_dir", options.cache)
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    model, clip = load_model(options.model), Clip(options.clip, options.frames)
    scenes: dict[str, Callable[[], dict]] = {
        "static": lambda: static_pose(model, clip),
        "detail": lambda: no_detail(model, clip),
        "single": lambda: single_frame(model, clip),
        "many": lambda: many_motions(model, clip),
        "contact": lambda: no_contact(model, clip),
    }
    if options.memoryless:
        other = trained_model(options.memoryless)
        settings = replace(other.config, rollout=model.config.rollout)  # chunks of one length
        scenes["tight"] = lambda: tight(model, clip, other._replace(config=settings))
    chosen = options.only or list(scenes)
    rows = [scenes[name]() for name in chosen]
    facts = {"model": str(options.model), "clip": options.clip.stem, "frames": len(clip.motion.root)}
    report(rows, title="What scenes can leave out", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
