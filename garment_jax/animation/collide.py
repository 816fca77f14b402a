"""`garment-jax collide`: the collisions of a finished sequence, resolved alone and by windows."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from garment_jax.animation.stream import body_frames, chunk_shapes, contact_programs, first_of
from garment_jax.aot_cache import ProgramStore, compiling
from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.limbs import limbs_of
from garment_jax.body.root_frame import from_root, heading, to_root
from garment_jax.config import CollisionConfig
from garment_jax.dataset.lanes import repeated_last
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.io.overwrite_checks import COLLIDED, check_sequence_name
from garment_jax.io.sequence import DEFAULT_SCALE, Sequence, SequenceWriter, open_sequence
from garment_jax.io.validation import check_input
from garment_jax.postprocess.collision.options import CollisionOptions
from garment_jax.postprocess.collision.result import MESSAGES, Outcome
from garment_jax.postprocess.collision.solid import Solid, solid_for
from garment_jax.postprocess.figures import FrameFigures, join_figures, per_frame_columns
from garment_jax.postprocess.tables import make_contact_tables
from garment_jax.progress import FrameProgress
from garment_jax.storage.overwriting import check_free

WINDOW = 64  # frames in memory at a time, and in one compiled piece
LARGEST_EPS = 0.1  # metres; farther out a garment is a balloon
LARGEST_ITERATIONS = 100_000  # of which none has needed more than a few hundred


class Report(NamedTuple):
    """A sequence's collision handling."""

    frames: int
    seconds: float
    figures: FrameFigures


def collide_file(
    path: str | Path,
    out: str | Path,
    *,
    body: str | Path | None = None,
    whole_body: bool = False,
    eps: float = CollisionConfig.eps,
    iterations: int = CollisionConfig.iterations,
    limbs: bool = CollisionConfig.limbs,
    untangle: bool = CollisionConfig.untangle,
    force: bool = False,
    store: ProgramStore | None = None,
) -> Report:
    """Resolve the collisions of the sequence file `path`, write the sequence file `out`, report.

    The collider is that of the scene, or with `whole_body` all of its body. `body` names another
    sequence file of as many frames, whose moving body takes the place of the sequence's own, or a rigged
    body (`.npz`), which follows the sequence's motion and is taken whole. `eps` in metres. With `limbs` what
    a limb has passed through is put back on its side first (`undo_crossings`); with `untangle` crossings of
    the garment with itself are undone, too. Pinned vertices stay where the sequence has them. Attributes,
    encoding and per-frame data are kept; `extra/collision_...` are added. `store` keeps the compiled program
    between runs. Raises `ValueError` or `OSError` in one sentence; so for an `out` that is there, without
    `force`.
    """
    _check_settings(eps, iterations)
    _check_paths(Path(path), Path(out), body, force)
    began = time.perf_counter()
    with open_sequence(path) as sequence:
        check_input(sequence)
        sequence.read(0, 1)  # a motion without vertices is refused before anything is made
        solid = solid_for(sequence, body, whole_body=whole_body)
        options = CollisionOptions(eps=eps, iterations=iterations, tolerance=CollisionConfig.tolerance)
        writer = SequenceWriter(
            out,
            solid.scene,
            solid.motion,
            encoding=sequence.encoding,
            scale=sequence.scale or DEFAULT_SCALE,
            attributes=sequence.attributes | {COLLIDED: eps},
        )
        pieces: list[FrameFigures] = []
        with FrameProgress(sequence.name) as progress, writer:
            progress.say(compiling(store))
            for start, V, piece in _resolved(sequence, solid, options, limbs, untangle, store):
                writer.append(V)
                pieces.append(piece)
                progress(start + len(V), sequence.frames)
            figures = join_figures(pieces)
            for name, values in (_kept_columns(sequence) | per_frame_columns(figures)).items():
                writer.add_per_frame(name, values)
        return Report(sequence.frames, time.perf_counter() - began, figures)


def summary(report: Report) -> list[str]:
    """Return what to print: a line of figures, then lines for limbs and for how frames fell short."""
    f, worst = FrameFigures(*map(np.asarray, report.figures)), int(np.argmax(report.figures.pop))
    pierced = np.asarray(f.pierced) > 0
    short = ~np.isin(f.outcome, (Outcome.NOTHING_TO_DO, Outcome.CONVERGED))
    lines = [
        f"{report.frames} frames, {report.frames / report.seconds:.0f} frames/s with the start; "
        f"deepest {1e3 * f.deepest_before.max():.2f} mm before, {1e3 * f.deepest_after.max():.2f} after; "
        f"vertices inside, over all frames, {int(f.penetrating_before.sum())} before, "
        f"{int(f.penetrating_after.sum())} after; {short.sum()} frames not converged; "
        f"largest pop {1e3 * f.pop[worst]:.2f} mm (frame {worst})"
    ]
    if pierced.any():
        lines.append(f"{_frames(pierced)}: a limb ran through the cloth, put back where its side was known.")
    if (tangled := np.asarray(f.self_crossings) > 0).any():
        lines.append(f"{_frames(tangled)}: the garment still goes through itself.")
    for outcome in np.unique(f.outcome[short]):
        lines.append(f"{_frames(np.asarray(f.outcome) == outcome)}: {MESSAGES[Outcome(int(outcome))]}")
    return lines


def _frames(which: np.ndarray) -> str:
    """Return the marked frames in words."""
    frames = np.flatnonzero(which)
    first = ", ".join(map(str, frames[:5])) + (", …" if len(frames) > 5 else "")
    return f"{len(frames)} {'frame' if len(frames) == 1 else 'frames'} ({first})"


def _check_settings(eps: float, iterations: int) -> None:
    if not 0 <= eps <= LARGEST_EPS:
        raise ValueError(
            f"--eps {1e3 * eps:g} mm is out of range; give 0 to {1e3 * LARGEST_EPS:g} millimetres, such as "
            f"{1e3 * CollisionConfig.eps:g}."
        )
    if not 0 <= iterations <= LARGEST_ITERATIONS:
        raise ValueError(
            f"--iterations {iterations} is out of range; give the gradient steps a frame may take, 0 to "
            f"{LARGEST_ITERATIONS}, such as {CollisionConfig.iterations}."
        )


def _check_paths(path: Path, out: Path, body: str | Path | None, force: bool) -> None:
    for given in (path, body):
        if given is not None and out.resolve() == Path(given).resolve():
            raise ValueError(f"--out {out} is what is read, {given}; write to another file.")
    check_sequence_name(out)
    check_free(out, force)


def _kept_columns(sequence: Sequence) -> dict[str, np.ndarray]:
    """Return the sequence's own per-frame data; a few values a frame."""
    return {name: sequence.read_extra(name, 0, sequence.frames) for name in sequence.extra_names}


def _resolved(
    sequence: Sequence,
    solid: Solid,
    options: CollisionOptions,
    limbs: bool,
    untangle: bool,
    store: ProgramStore | None,
) -> Iterator[tuple[int, np.ndarray, FrameFigures]]:
    """Yield `(start, V [k, n, 3] world metres, figures)` by windows, each after the last one's contacts."""
    scene, motion = solid.scene._replace(pins=None, collider=solid.collider), solid.motion
    garment, pins = sequence.scene.garment, sequence.scene.pins
    held = np.zeros(0, np.int32) if pins is None else pins.vertices
    bones = limbs_of(scene.body, solid.collider) if limbs else None
    laplacian = uniform_table(garment.faces, len(garment.template))
    tables = make_contact_tables(
        garment, laplacian, solid.collider, scene.body, held, limbs=bones, options=options, untangle=untangle
    )
    carried, state = carried_points(scene, collider=True, limbs=bones), None
    shapes = chunk_shapes(garment, carried, WINDOW, pins=len(held))
    contacts = contact_programs(tables, *shapes, programs=store or ProgramStore(None))
    for start, world in sequence.windows(min(WINDOW, sequence.frames)):
        count = len(world)
        frames = slice(start, start + count)
        _check_finite(world, start, str(sequence.path))
        root, yaw = motion.root[frames].astype(np.float64), heading(motion.rotations[frames, 0])
        V = to_root(world.astype(np.float64), root, yaw).astype(np.float32)
        posed = pose_carried(carried, scene, motion, frames)._replace(pins=V[:, held])
        body, V_f = body_frames(posed, WINDOW), jnp.asarray(repeated_last(V, WINDOW))
        state = contacts.init(V_f[0], first_of(body)) if state is None else state
        state, resolved, figures = contacts.run(state, V_f, body)
        moved = np.asarray(resolved)[:count]
        placed = from_root(moved.astype(np.float64), root, yaw).astype(np.float32)
        # What did not move keeps its digits: turning there and back would change the last one.
        V_world = np.where((moved != V).any(axis=-1, keepdims=True), placed, world)
        yield start, V_world, FrameFigures(*(np.asarray(x)[:count] for x in figures))


def _check_finite(V: np.ndarray, start: int, name: str) -> None:
    bad = ~np.isfinite(V).all(axis=(1, 2))
    if bad.any():
        raise ValueError(
            f"{name}: frame {start + int(bad.argmax())} is not finite; the rollout diverged or the file is "
            "damaged, make it again."
        )
