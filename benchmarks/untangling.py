"""What untangling costs and leaves, on rollouts made without collision handling.

    garment-jax animate skirt MOTION --no-collision --out raw/MOTION.h5
    python benchmarks/untangling.py raw/*.h5 [--vertices N] [--every 3] [--json FILE]

Every frame is resolved twice, with and without, one call a frame, each call the best of three. A frame's
cost is the difference. "near": frames that were flattened, or where patches had to be looked into; "far":
the others. Edges through faces are counted by ipctk (extra `test`) in every third flattened frame, before
and after. "pop" is the largest change of a vertex' correction between frames, with and without.
"""

import argparse
import sys
import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from collision import Clip, calls_of, read

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the count lives with the tests
from garment_jax.animation.chunks import Step, scan_frames, solver_options
from garment_jax.bench.figures import report
from garment_jax.geometry.self_crossings import near_patches
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import open_sequence
from garment_jax.postprocess.pipeline import contact_init, contact_step
from garment_jax.postprocess.tables import ContactTables
from garment_jax.postprocess.untangling import make_untangle_tables
from tests.reference.crossing_edges import crossing_edges

PASSES = 3  # over a clip: each call's best counts


class Program(NamedTuple):
    """Contacts of a garment and its body, compiled once."""

    tables: ContactTables
    run: Step


def programs(clip: Clip, *, known: list[tuple[Clip, Program, Program]]) -> tuple[Program, Program]:
    """Return the programs without and with untangling; `known` keeps them for clips of the same scene."""
    for other, *both in known:
        pairs = [(x.template, x.faces, x.tables.pins) for x in (other, clip)]
        if all(np.array_equal(a, b) for a, b in zip(*pairs, strict=True)):  # of one model: one body
            return both[0], both[1]
    own = make_untangle_tables(clip.template, clip.faces, clip.tables.pins)
    options = solver_options(clip.V.shape[1])
    off, on = (
        Program(tables, scan_frames(partial(contact_step, tables=tables), options))
        for tables in (clip.tables, clip.tables._replace(untangle=own))
    )
    known.append((clip, off, on))
    return off, on


def resolved(clip: Clip, program: Program) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return each frame's milliseconds, its garment, whether it was flattened, and its pop (cm)."""
    pieces, (tables, run) = calls_of(clip, 1), program
    wall, garments, flattened, pops = np.full((PASSES, len(pieces)), np.nan), [], [], []
    for again in range(PASSES):
        first = jax.tree.map(lambda x: jnp.asarray(x[0]), (clip.V, clip.body))
        carry = contact_init(*first, tables=tables)
        if again == 0:
            jax.block_until_ready(run(carry, *pieces[0]))  # compiled
            carry = contact_init(*first, tables=tables)
        for k, piece in enumerate(pieces):
            began = time.perf_counter()
            carry, V, figures = jax.block_until_ready(run(carry, *piece))
            wall[again, k] = 1e3 * (time.perf_counter() - began)
            if again == 0:
                garments.append(np.asarray(V[0]))
                flattened.append(carry.untangle is not None and bool(carry.untangle.weight.any()))
                pops.append(float(figures.pop[0]))
    return wall.min(axis=0), np.stack(garments), np.array(flattened), 100 * np.array(pops)


class Measured(NamedTuple):
    """What a clip's frames took and came to."""

    off: np.ndarray  # [t] milliseconds
    extra: np.ndarray  # [t] milliseconds more
    near: np.ndarray  # [t] bool
    flattened: np.ndarray  # [t] bool
    before: np.ndarray  # [c] int, edges through faces in the frames that are counted
    after: np.ndarray  # [c]
    pops_off: np.ndarray  # [t] centimetres
    pops: np.ndarray  # [t]
    change: np.ndarray  # [t] centimetres, of the vertex that moves most


def measure(path: Path, options: argparse.Namespace, known: list) -> Measured:
    """Return what one clip's frames took, with and without."""
    clip = read(path, options)
    without, with_it = programs(clip, known=known)
    off, plain, _, pops_off = resolved(clip, without)
    on, apart, flattened, pops = resolved(clip, with_it)
    own = with_it.tables.untangle
    assert own is not None
    looked = jax.jit(partial(near_patches, tables=own.crossings))
    near = flattened | np.array([bool(looked(jnp.asarray(V)).any()) for V in apart])
    edges = unique_edges(clip.faces)
    changed = np.flatnonzero(flattened)[:: options.every]
    counts = [[crossing_edges(V[k], edges, clip.faces) for k in changed] for V in (plain, apart)]
    before, after = (np.array(each, int) for each in counts)
    change = 100 * np.linalg.norm(apart - plain, axis=-1).max(axis=-1)
    return Measured(off, on - off, near, flattened, before, after, pops_off, pops, change)


def row(name: str, clips: list[Measured]) -> dict:
    """Return one line of the report, of all frames of these clips."""
    own = Measured(*map(np.concatenate, zip(*clips, strict=True)))
    middle = lambda x: float(np.median(x)) if len(x) else float("nan")  # noqa: E731
    return {
        "clip": name,
        "frames": len(own.off),
        "near": int(own.near.sum()),
        "flattened": int(own.flattened.sum()),
        "without ms": middle(own.off),
        "far +ms": middle(own.extra[~own.near]),
        "near +ms": middle(own.extra[own.near]),
        "flattened +ms": middle(own.extra[own.flattened]),
        "p95 +ms": float(np.percentile(own.extra[own.near], 95)) if own.near.any() else float("nan"),
        "counted": len(own.before),
        "crossed before": int((own.before > 0).sum()),
        "after": int((own.after > 0).sum()),
        "most edges before": int(own.before.max(initial=0)),
        "most after": int(own.after.max(initial=0)),
        "pop before cm": float(own.pops_off.max()),
        "pop cm": float(own.pops.max()),
        "change cm": float(own.change.max()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sequences", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=10_000, help="of each sequence at most")
    parser.add_argument("--vertices", type=int, help="of the garment, no fewer than it has")
    parser.add_argument("--every", type=int, default=3, help="of the flattened frames are counted")
    parser.add_argument("--json", type=Path)
    parser.set_defaults(whole_body=False, solver_alone=False)
    options = parser.parse_args()
    with open_sequence(options.sequences[0]) as clip:
        vertices = options.vertices or len(clip.scene.garment.template)
    known: list[tuple[Clip, Program, Program]] = []  # of one model's clips: compiled once
    clips = {path.stem: measure(path, options, known) for path in options.sequences}
    rows = [row(name, [clip]) for name, clip in clips.items()]
    if len(rows) > 1:
        rows.append(row("all", list(clips.values())))
    report(rows, title="untangling a frame", facts={"vertices": vertices}, json_path=options.json)


if __name__ == "__main__":
    main()
