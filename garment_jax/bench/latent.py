"""A LATENT job: how smooth the garments between two latents are (paper 4.2, Fig. 5)."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.bench.files import write_json
from garment_jax.bench.plan import Job, Plan
from garment_jax.body.garment_skinning import garment_transforms
from garment_jax.body.root_frame import heading, to_root
from garment_jax.dataset.template import Template
from garment_jax.geometry.skinning import unskin_frames
from garment_jax.io.sequence import open_sequence
from garment_jax.machine import machine
from garment_jax.model.generative.network import decode, encode
from garment_jax.model.store import Model, template_for
from garment_jax.storage.whole import written_whole
from garment_jax.structs import Motion
from garment_jax.training.pipeline import trained_model

PAIRS, SHOWN, STEPS = 24, 2, 11  # pairs of true frames, those that are drawn, shapes from one to the other


class Smoothness(NamedTuple):
    """How evenly a row of shapes changes."""

    step_mm: float  # mean distance that a vertex moves from one shape to the next
    bend_mm: float  # mean length of the second difference of a vertex's path; 0: straight and even
    ratio: float  # bend over step


def smoothness(shapes: np.ndarray) -> Smoothness:
    """Return first and second differences of `shapes` `[k, n, 3]` metres; k at least 3."""
    if len(shapes) < 3:
        raise ValueError(f"{len(shapes)} shapes have no second difference; give 3 or more.")
    first = np.linalg.norm(np.diff(shapes, axis=0), axis=-1).mean()
    second = np.linalg.norm(np.diff(shapes, n=2, axis=0), axis=-1).mean()
    return Smoothness(1e3 * float(first), 1e3 * float(second), float(second / first) if first > 0 else 0.0)


def between(model: Model, ends: Any, template: Any) -> Any:
    """Return the shapes `[STEPS, n, 3]` decoded evenly between the latents of `ends` `[2, n, 3]`.

    All in the networks' frame.
    """
    params, config = model.params["generative"], model.config.generative
    mean = encode(params, ends, template=template, config=config).mean
    part = jnp.linspace(0.0, 1.0, STEPS)[:, None]
    Z = (1 - part) * mean[:1] + part * mean[1:]
    return decode(params, Z, template=template, config=config).V


def measure_latent(plan: Plan, job: Job) -> None:
    """Interpolate between random true frames of the test clips and write figures and two rows of shapes."""
    model = trained_model(plan.run_dir(job.run))
    rng = np.random.default_rng(0)
    with open_sequence(plan.test[0]) as clip:
        template, _ = template_for(model, clip.scene, clip.name)
    ends = np.stack([_random_frame(plan, rng, template) for _ in range(2 * PAIRS)]).reshape(PAIRS, 2, -1, 3)
    shapes_of = jax.jit(lambda pair: between(model, pair, template))
    rows = [np.asarray(shapes_of(pair)) for pair in ends]
    figures = [smoothness(row) for row in rows]
    with written_whole(job.done.with_suffix(".npz")) as (made,):
        np.savez_compressed(made, shapes=np.stack(rows[:SHOWN]).astype(np.float32))
    record = {
        "row": job.row,
        "run": job.run,
        "seed": job.seed,
        "pairs": PAIRS,
        "steps": STEPS,
        **{name: float(np.median([getattr(f, name) for f in figures])) for name in Smoothness._fields},
        "ratio_worst": max(f.ratio for f in figures),
        "machine": machine(),
    }
    write_json(job.done, record)


def _random_frame(plan: Plan, rng: np.random.Generator, template: Template) -> np.ndarray:
    """Return a random true frame `[n, 3]` float32 of a random test clip, in the networks' frame."""
    with open_sequence(plan.test[int(rng.integers(len(plan.test)))]) as clip:
        t = int(rng.integers(clip.frames))
        V, scene = clip.read(t, t + 1).astype(np.float64), clip.scene
        motion = Motion(clip.motion.rotations[t : t + 1], clip.motion.root[t : t + 1], clip.fps)
    local = to_root(V, motion.root.astype(np.float64), heading(motion.rotations[:, 0])).astype(np.float32)
    if template.W is not None:
        local = np.asarray(unskin_frames(local, template.W, *garment_transforms(motion, scene)))
    return local[0]
