"""Milliseconds a frame of a trained model: streams with and without detail and collision, and a batch.

    python benchmarks/rollout_speed.py MODEL CLIP [--frames 512] [--chunk 32] [--json FILE]

"stream" is what infer.py does but for the file: a compiled chunk of frames after the other, pins, collider
and world placement included; a sample is a chunk's time divided by its frames. "scan" is the networks alone
in such chunks, "step" one frame in, one frame out, as an engine calls it. "batch" is 16 copies of the motion
side by side; its figures are per frame of each copy. "first" is the first call: tracing and compilation.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path

import jax
import numpy as np
from measured import report

from garment_jax.animation.animate import animate
from garment_jax.animation.clips import rollout_chunks, stack_motions
from garment_jax.body.seeds import Seeds
from garment_jax.dataset.motion_input import MotionInput
from garment_jax.dataset.start import make_start
from garment_jax.dataset.template import Template
from garment_jax.io.sequence import open_sequence
from garment_jax.model.compose import RolloutState, init_state, step
from garment_jax.model.scan import make_rollout
from garment_jax.model.store import Model, model_input, template_for
from garment_jax.structs import FrameInput, Motion, Scene
from garment_jax.training.pipeline import trained_model

BATCH = 16


def timed(pieces: Iterator[int], name: str) -> dict:
    """Return milliseconds a frame of an iterator that yields how many frames it has just finished."""
    seconds, frames = [], []
    began = time.perf_counter()
    for count in pieces:
        seconds.append(time.perf_counter() - began)
        frames.append(count)
        began = time.perf_counter()
    samples = 1e3 * np.array(seconds[1:]) / np.array(frames[1:])
    total = sum(frames[1:]) / sum(seconds[1:])
    median, late = np.percentile(samples, [50, 95])
    return {
        "variant": name,
        "median ms": float(median),
        "p95 ms": float(late),
        "frames/s": float(total),
        "first s": float(seconds[0]),
    }


def stream(model: Model, scene: Scene, motion: Motion, **options) -> Iterator[int]:
    for piece in animate(model, scene, motion, **options):
        yield len(piece.V)


def scan(run: Callable, params: dict, state: RolloutState, x: FrameInput, chunk: int) -> Iterator[int]:
    for _, V in rollout_chunks(run, params, state, x, chunk=chunk):
        np.asarray(V)  # on the host, as whoever wants to see it needs it
        yield chunk * (V.shape[1] if V.ndim == 4 else 1)


def frame_by_frame(one: Callable, params: dict, state: RolloutState, x: FrameInput) -> Iterator[int]:
    for t in range(len(x.M)):
        state, V = one(params, state, jax.tree.map(itemgetter(t), x))
        np.asarray(V)
        yield 1


def many_of(model: Model, template: Template, seeds: Seeds, x: MotionInput) -> RolloutState:
    """Return the state before the first frame, `BATCH` times."""
    begin = make_start(template, seeds, model.config.body.tau)
    V = begin(np.repeat(x.R_seed[:1], BATCH, axis=0), np.repeat(x.t_seed[:1], BATCH, axis=0))
    return init_state(model.params, V, template=template, config=model.config)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", help="a run of train.py or a saved model")
    parser.add_argument("clip", help="sequence file with the motion")
    parser.add_argument("--frames", type=int, default=512)
    parser.add_argument("--chunk", type=int, default=32)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model = trained_model(options.model)
    model = model._replace(
        config=replace(model.config, rollout=replace(model.config.rollout, chunk=options.chunk))
    )
    with open_sequence(options.clip) as sequence:
        scene, name = sequence.scene, sequence.name
        count = min(options.frames, sequence.frames) // options.chunk * options.chunk
        motion = Motion(sequence.motion.rotations[:count], sequence.motion.root[:count], sequence.fps)
    template, seeds = template_for(model, scene, name)
    inputs = model_input(model, scene, template, seeds, motion)
    many = many_of(model, template, seeds, inputs)
    single = jax.tree.map(itemgetter(0), many)
    rows = []
    for detail in [False, True] if "detail" in model.params else [False]:
        kind = "detail" if detail else "no detail"
        run = make_rollout(template, model.config, detail=detail)
        one = jax.jit(partial(step, template=template, config=model.config, detail=detail))
        rows.append(timed(scan(run, model.params, single, inputs.x, options.chunk), f"scan, {kind}"))
        rows.append(timed(frame_by_frame(one, model.params, single, inputs.x), f"step, {kind}"))
        for collision in (False, True):
            pieces = stream(model, scene, motion, detail=detail, collision=collision)
            rows.append(timed(pieces, f"stream, {kind}, {'' if collision else 'no '}collision"))
        x, _ = stack_motions([inputs.x] * BATCH, options.chunk)
        rows.append(timed(scan(run, model.params, many, x, options.chunk), f"batch of {BATCH}, {kind}"))
    facts = {
        "model": options.model,
        "clip": name,
        "frames": count,
        "vertices": model.vertices,
        "UV": model.config.uv.size,
        "E_s": "on" if model.config.motion.previous_state else "off",
    }
    report(rows, title="Rollout speed", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
