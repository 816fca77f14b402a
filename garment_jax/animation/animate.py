"""A whole motion through a whole model, streamed: the work of `infer.py`."""

import re
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from garment_jax.animation.frame_method import FrameMethod, stream_motion
from garment_jax.animation.network_method import compile_networks, network_method
from garment_jax.animation.plan import ScenePlan, make_plan
from garment_jax.animation.stream import Chunk, PostprocessStream
from garment_jax.aot_cache import Program, ProgramStore, compiling
from garment_jax.body.frame_windows import first_frames, stretches
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

STILL = 10.0  # ranges beyond a feature's from which on it hardly moved in training: a stiff back, say
_BEYOND = {  # what a joint does more than in training, by the feature that says so
    "tilt": ("tilts", "farther"),
    "rotation": ("turns", "farther"),
    "velocity": ("moves", "faster"),
    "yaw rate": ("turns", "faster"),
    "position": ("reaches", "farther"),
}
_LONG = 0.75  # part of int16's reach: a template that is longer may swing out of it


class Early(NamedTuple):
    """What wants to see the first frames while contact handling is compiled."""

    path: Path  # a sequence file, to be written
    show: Callable[[], None]  # called when it is there
    frames: int = 64


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


class Animator:
    """What animates motions of one scene; `make_animator` makes it."""

    def __init__(
        self,
        model: Model,
        template: Template,
        postprocess: PostprocessStream,
        method: FrameMethod,
        rollout: Program,
    ) -> None:
        self._model, self._template, self._postprocess = model, template, postprocess
        self._method, self._rollout = method, rollout

    def __call__(self, motion: Motion, *, preroll: int = 0, name: str = "the clip") -> Iterator[Chunk]:
        """Yield a motion's chunks, as `animate`."""
        check_rate(self._model, motion, name)
        whole = with_preroll(motion, preroll)
        pieces = self._postprocess(*self._streamed(whole))
        return _blaming(_without_first(pieces, preroll), self._model, self._template)

    def early(self, motion: Motion, frames: int) -> Iterator[Chunk] | None:
        """Yield the first `frames` without contact handling; None unless that has to be compiled."""
        self._rollout.wait()
        if not self._postprocess.compiling:
            return None
        return self._postprocess.before_contacts(*self._streamed(until(motion, frames)))

    def give_up(self) -> bool:
        """Do not compile what has not begun to be; return whether that is so, and no frame can be had."""
        return self._postprocess.gate.close()

    def _streamed(self, motion: Motion) -> tuple[Motion, np.ndarray, np.ndarray, Iterator]:
        root, yaw = motion.root.astype(np.float64), headings(motion)
        return motion, root, yaw, stream_motion(self._method, self._rollout, motion)


def make_animator(
    model: Model,
    scene: Scene,
    *,
    detail: bool = True,
    collision: bool = True,
    out_of_reach: bool = False,
    store: ProgramStore | None = None,
    early: bool = False,
    name: str = "the clip",
) -> Animator:
    """Return what yields a motion's chunks as `animate` does, called (motion, preroll=0, name="the clip").

    Its programs are compiled once, whatever the motions' lengths. `out_of_reach`: a distance bound says that
    the cloth cannot touch the collider (`make_plan`); then collision handling is left out, not even
    compiled, until a frame leaves the bound. `store` keeps programs between runs. With `early` contact
    handling is not compiled before the frames of the first call are asked for, so that those of
    `Animator.early` are soon there. Raises `ValueError` as `animate` does.
    """
    template, seeds = template_for(model, scene, name)
    programs = store or ProgramStore(None)
    facts = {
        "scene": rollout_hash(scene),
        "model": repr(model.config),
        "statistics": _digits(model.statistics),
        "detail": detail,
    }
    # first: frames without contact handling are there long before that is compiled
    method = network_method(model, scene, template, seeds, detail=detail)
    rollout = compile_networks(method, model, scene, template, programs=programs, facts=facts)

    postprocess = PostprocessStream(
        model.config,
        scene,
        template,
        collision=collision,
        out_of_reach=out_of_reach,
        programs=programs,
        early=early,
    )
    return Animator(model, template, postprocess, method, rollout)


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
    early: Early | None = None,
    stop: int | None = None,
) -> dict[str, float]:
    """Animate the motion of the sequence file `clip` and write the sequence file `out`; return figures.

    `plan` says what to leave out (`make_plan`; made here if not given). `animators` keeps what is compiled
    for the next clip of the same model: pass one dictionary for all. `early` gets the first frames as they
    are before contact handling, where that has to be compiled. `stop`: frame before which the motion ends.
    Raises `ValueError` where `out` is `clip`, and what `animate` refuses; replaces what is there. Progress
    goes to standard error. The file appears when it is whole. Per frame it also holds how far the motion
    leaves the training range (`extra/outside_training_range`, in ranges; 0 inside), and what collision
    handling did (`extra/collision_...`, see `docs/collision.md`).
    """
    check_animation_out(Path(out), Path(clip))
    with open_sequence(clip) as sequence:
        return _animate_open(
            model, sequence, Path(out), detail, collision, preroll, plan, store, animators, early, stop
        )


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
    early: Early | None,
    stop: int | None,
) -> dict[str, float]:
    check_input(sequence, joints=model.config.body.motion_joints)
    clip, scene, name = sequence.path, sequence.scene, sequence.name
    motion = until(sequence.long_motion, stop)
    encoding, scale = _stored_as(sequence)
    outside, worst = training_range(model, scene, motion)
    plan = plan or make_plan(facts_of(model), scene, motion, detail=detail, collision=collision)
    model = model if plan.column_rnn else without_column_rnn(model)
    began = time.perf_counter()
    frames, deepest = 0, 0.0
    figures, known = None, 0
    attributes = {"kind": "predicted", "name": name}
    made = {} if animators is None else animators
    run = animator_for(model, scene, plan, store, str(clip), made, early=early is not None)
    with ExitStack() as stack:
        stack.callback(_give_up, run, made)  # where it is refused before its first frame
        pieces = run(motion, preroll=preroll, name=str(clip))
        progress = stack.enter_context(FrameProgress(name))
        writer = stack.enter_context(
            SequenceWriter(out, scene, motion, encoding=encoding, scale=scale, attributes=attributes)
        )
        progress.say(compiling(store) + (f", then {preroll} frames of preroll" if preroll else ""))
        if early is not None:
            _show_early(run, scene, motion, early)
        for piece in pieces:
            writer.append(piece.V)
            frames, deepest = frames + len(piece.V), max(deepest, float(piece.deepest.max()))
            if piece.collision is not None:
                figures = figures or jax.tree.map(partial(_column, len(motion.root)), piece.collision)
                jax.tree.map(partial(_put, frames - len(piece.V)), figures, piece.collision)
                known += len(piece.V)
            progress(frames, len(motion.root))
        writer.add_per_frame("outside_training_range", outside)
        if figures is not None and known == frames:
            for column, values in per_frame_columns(figures).items():
                writer.add_per_frame(column, values)
    if outside.max() > 0.1:
        said = _beyond_range(float(outside.max()), worst, int(outside.argmax()), motion.fps)
        print(f"{name}: {said}", file=sys.stderr)
    return {"frames": frames, "seconds": time.perf_counter() - began, "deepest_mm_before": 1e3 * deepest}


def until(motion: Motion, stop: int | None) -> Motion:
    """Return the motion before frame `stop`, or all of it: no frame depends on those that follow."""
    if stop is None:
        return motion
    return motion._replace(rotations=first_frames(motion.rotations, stop), root=motion.root[:stop])


def _give_up(run: Animator, known: dict[tuple, Animator]) -> None:
    """Forget an animator whose contact handling was not begun to be compiled, and will not be."""
    if run.give_up():
        for key in [key for key, other in known.items() if other is run]:
            del known[key]


def _show_early(run: Animator, scene: Scene, motion: Motion, early: Early) -> None:
    """Write the first frames as `early` wants them, where contact handling is still being compiled."""
    chunks = run.early(motion, early.frames)
    if chunks is None:
        return
    first, about = until(motion, early.frames), {"kind": "predicted"}
    with SequenceWriter(early.path, scene, first, encoding="float32", attributes=about) as made:
        for piece in chunks:
            made.append(piece.V)
    early.show()


def animator_for(
    model: Model,
    scene: Scene,
    plan: ScenePlan,
    store: ProgramStore | None,
    name: str,
    known: dict[tuple, Animator],
    *,
    early: bool = False,
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
            early=early,
            name=name,
        )
    return known[key]


def _beyond_range(ranges: float, feature: str, frame: int, fps: float) -> str:
    """Return the sentence on a motion that leaves the training range by so many `ranges` of a feature."""
    found = re.fullmatch(r"(.+) (tilt|rotation|velocity|yaw rate|position) .+", feature)
    who, what = (feature, "position") if found is None else found.groups()
    verb, more = _BEYOND[what]
    than = f"{more} than in any training motion" if ranges <= STILL else "which it hardly did in training"
    return (
        f"frame {frame} ({frame / fps:.1f} s): {'the root' if who == 'root' else who} {verb}"
        f"{',' * (ranges > STILL)} {than}; it is clamped there, so the cloth may lag or stretch."
    )


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
