"""A whole motion through a whole model, streamed: the work of `infer.py`."""

import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import jax
import numpy as np

from garment_jax.animation.frame_method import stream_motion
from garment_jax.animation.network_method import compile_networks, network_method
from garment_jax.animation.plan import ScenePlan, make_plan
from garment_jax.animation.stream import Chunk, PostprocessStream
from garment_jax.aot_cache import ProgramStore
from garment_jax.body.frame_windows import stretches
from garment_jax.body.motion_features import chosen_joints, feature_names, motion_features
from garment_jax.body.preroll import with_preroll
from garment_jax.body.root_frame import headings
from garment_jax.dataset.template import Template
from garment_jax.io.content_hash import rollout_hash
from garment_jax.io.overwrite_checks import check_animation_out
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.io.sequence_writer import DEFAULT_SCALE, INT16_REACH, SequenceWriter
from garment_jax.io.validation import check_input, check_poses
from garment_jax.model.misfit import check_parameters
from garment_jax.model.store import Model, check_rate, facts_of, template_for, without_column_rnn
from garment_jax.postprocess.figures import per_frame_columns
from garment_jax.progress import FrameProgress
from garment_jax.structs import Motion, Scene

_LONG = 0.75  # part of int16's reach: a template that is longer may swing out of it


Animator = Callable[..., Iterator[Chunk]]


def animate(
    model: Model,
    scene: Scene,
    motion: Motion,
    *,
    detail: bool = True,
    collision: bool = True,
    preroll: int = 0,
    name: str = "the clip",
) -> Iterator[Chunk]:
    """Yield the garment of `motion`, chunk by chunk, world frame; memory does not grow with its length.

    Begins from the skinned template (with `preroll`, from the template itself, `preroll` frames before).
    What comes after the networks is in `postprocess.pipeline`. Raises `ValueError` for a garment or a frame
    rate that the model was not trained on, a joint that the body lacks, or a motion that is not finite.
    """
    check_poses(motion, name, joints=scene.body.joint_names)
    run = make_animator(model, scene, detail=detail, collision=collision, name=name)
    yield from run(motion, preroll=preroll, name=name)


def make_animator(
    model: Model,
    scene: Scene,
    *,
    detail: bool = True,
    collision: bool = True,
    out_of_reach: bool = False,
    store: ProgramStore | None = None,
    name: str = "the clip",
) -> Animator:
    """Return a function (motion, preroll=0, name="the clip") that yields its chunks as `animate` does.

    Its programs are compiled once, whatever the motions' lengths. `out_of_reach`: a distance bound says that
    the cloth cannot touch the collider (`make_plan`); then collision handling is left out, not even
    compiled, until a frame leaves the bound. `store` keeps programs between runs. Raises `ValueError` as
    `animate` does.
    """
    template, seeds = template_for(model, scene, name)
    programs = store or ProgramStore(None)
    facts = {
        "scene": rollout_hash(scene),
        "model": repr(model.config),
        "statistics": _digits(model.statistics),
        "detail": detail,
    }
    postprocess = PostprocessStream(
        model.config,
        scene,
        template,
        collision=collision,
        out_of_reach=out_of_reach,
        programs=programs,
    )
    method = network_method(model, scene, template, seeds, detail=detail)
    rollout = compile_networks(method, model, scene, template, programs=programs, facts=facts)

    def run(motion: Motion, *, preroll: int = 0, name: str = "the clip") -> Iterator[Chunk]:
        check_rate(model, motion, name)
        whole = with_preroll(motion, preroll)
        root, yaw = whole.root.astype(np.float64), headings(whole)
        pieces = postprocess(whole, root, yaw, stream_motion(method, rollout, whole))
        return _blaming(_without_first(pieces, preroll), model, template)

    return run


def _blaming(pieces: Iterator[Chunk], model: Model, template: Template) -> Iterator[Chunk]:
    """Yield the pieces; say so where they fail because the model's parameters are not its networks'.

    Looked at then, and not before: it would cost every start a second.
    """
    try:
        yield from pieces
    except Exception:
        check_parameters(model, template)
        raise


def _without_first(pieces: Iterator[Chunk], skip: int) -> Iterator[Chunk]:
    for piece in pieces:
        if skip < len(piece.V):
            yield jax.tree.map(itemgetter(slice(skip, None)), piece)
        skip = max(skip - len(piece.V), 0)


def _digits(statistics: Any) -> str:
    return repr([np.asarray(x).tolist() for x in statistics])


def animate_file(
    model: Model,
    clip: str | Path,
    out: str | Path,
    *,
    detail: bool = True,
    collision: bool = True,
    preroll: int = 0,
    plan: ScenePlan | None = None,
    store: ProgramStore | None = None,
    animators: dict[tuple, Animator] | None = None,
) -> dict[str, float]:
    """Animate the motion of the sequence file `clip` and write the sequence file `out`; return figures.

    `plan` says what to leave out (`make_plan`; made here if not given). `animators` keeps what is compiled
    for the next clip of the same model: pass one dictionary for all. Raises `ValueError` where `out` is
    `clip`, or is there and no prediction, which it would replace, and what `animate` refuses. Progress goes
    to standard error. The file appears when it is whole. Per frame it also holds how far the motion leaves
    the training range (`extra/outside_training_range`, in ranges; 0 inside), and what collision handling did
    (`extra/collision_...`, see `docs/collision.md`).
    """
    check_animation_out(Path(out), Path(clip))
    with open_sequence(clip) as sequence:
        return _animate_open(model, sequence, Path(out), detail, collision, preroll, plan, store, animators)


def _animate_open(
    model: Model,
    sequence: Sequence,
    out: Path,
    detail: bool,
    collision: bool,
    preroll: int,
    plan: ScenePlan | None,
    store: ProgramStore | None,
    animators: dict[tuple, Animator] | None,
) -> dict[str, float]:
    check_input(sequence, joints=model.config.body.motion_joints)
    clip, scene, motion, name = sequence.path, sequence.scene, sequence.long_motion, sequence.name
    encoding, scale = _stored_as(sequence)
    outside, worst = training_range(model, scene, motion)
    plan = plan or make_plan(facts_of(model), scene, motion, detail=detail, collision=collision)
    model = model if plan.column_rnn else without_column_rnn(model)
    began = time.perf_counter()
    frames, deepest = 0, 0.0
    figures, known = None, 0
    attributes = {"kind": "predicted", "name": name}
    run = animator_for(model, scene, plan, store, str(clip), {} if animators is None else animators)
    pieces = run(motion, preroll=preroll, name=str(clip))
    writer = SequenceWriter(out, scene, motion, encoding=encoding, scale=scale, attributes=attributes)
    with FrameProgress(name) as progress, writer:
        progress.say("compiling" + (f", then {preroll} frames of preroll" if preroll else ""))
        for piece in pieces:
            writer.append(piece.V)
            frames, deepest = frames + len(piece.V), max(deepest, float(piece.deepest.max()))
            if piece.collision is not None:
                figures = figures or jax.tree.map(partial(_column, len(motion.root)), piece.collision)
                jax.tree.map(partial(_put, frames - len(piece.V)), figures, piece.collision)
                known += len(piece.V)
            if frames == len(piece.V):  # the first: it waited for its programs
                progress.begin(frames)
            else:
                progress(frames, len(motion.root))
        writer.add_per_frame("outside_training_range", outside)
        if figures is not None and known == frames:
            for column, values in per_frame_columns(figures).items():
                writer.add_per_frame(column, values)
    if outside.max() > 0.1:
        print(
            f"{name}: the motion leaves the training range by up to {outside.max():.0%} of it "
            f"({worst}, frame {int(outside.argmax())}); expect less there.",
            file=sys.stderr,
        )
    return {"frames": frames, "seconds": time.perf_counter() - began, "deepest_mm_before": 1e3 * deepest}


def animator_for(
    model: Model,
    scene: Scene,
    plan: ScenePlan,
    store: ProgramStore | None,
    name: str,
    known: dict[tuple, Animator],
) -> Animator:
    """Return what animates `scene` as planned, out of `known` where a clip before had the same."""
    key = (rollout_hash(scene), plan.column_rnn, plan.detail, plan.collision, plan.out_of_reach)
    if key not in known:
        known[key] = make_animator(
            model,
            scene,
            detail=plan.detail,
            collision=plan.collision or plan.out_of_reach,
            out_of_reach=plan.out_of_reach,
            store=store,
            name=name,
        )
    return known[key]


def _column(frames: int, first: np.ndarray) -> np.ndarray:
    return np.zeros((frames, *first.shape[1:]), first.dtype)


def _put(start: int, column: np.ndarray, values: np.ndarray) -> None:
    column[start : start + len(values)] = values


def _stored_as(sequence: Sequence) -> tuple[str, float]:
    """Return encoding and scale of a prediction: the clip's, and float32 for a long garment.

    A train or a long cape may swing out of int16's reach where its template is not far from it.
    """
    body, template = sequence.scene.body, sequence.scene.garment.template
    reach = float(np.linalg.norm(template - body.joints[:1], axis=1).max())
    long = sequence.encoding == "float32" or reach > _LONG * INT16_REACH
    return ("float32" if long else "int16"), sequence.scale or DEFAULT_SCALE


def training_range(model: Model, scene: Scene, motion: Motion) -> tuple[np.ndarray, str]:
    """Return how far each frame's motion lies outside the training range `[t]`, and the worst feature.

    In units of the feature's range (at least 3 of its deviations), the largest over features.
    """
    joints = chosen_joints(scene.body, model.config.body.motion_joints)
    s = model.statistics
    width = np.maximum(s.motion_high - s.motion_low, 3 * s.motion_std)
    beyond, features = np.zeros(len(motion.root), np.float32), np.zeros(len(motion.root), np.int32)
    for _, frames in stretches(len(motion.root)):
        M = motion_features(motion, scene.body, joints, frames)
        left = np.maximum(np.maximum(M - s.motion_high, s.motion_low - M), 0.0) / width
        beyond[frames], features[frames] = left.max(axis=1), left.argmax(axis=1)
    return beyond, feature_names(joints)[int(features[beyond.argmax()])]
