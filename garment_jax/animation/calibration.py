"""How long a model's variants take on this machine: measured once, kept in the user's cache folder.

Not in the paper. A stored time says nothing about another machine, so a few chunks of the motion at hand are
animated with each variant that a decision hangs on.
"""

import hashlib
import json
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.animation.animate import make_animator
from garment_jax.animation.variants import Variant, apply_variant, variants_of
from garment_jax.aot_cache import ProgramStore, only_newest, surroundings, usable
from garment_jax.model.store import Model
from garment_jax.progress import FrameProgress
from garment_jax.storage.whole import write_text
from garment_jax.structs import Motion, Scene

FRAMES = 32  # a chunk of the measured rollouts
CHUNKS = 12
KEPT = 64  # tables of times: of models, scenes and versions
AHEAD = 2  # chunks that the networks are ahead of what is handed out (`prefetch.py`)
# While the first chunk's collisions compile the next ones are made ahead, and at the end nothing is left to
# make: both would show the last stage alone.
COUNTED = slice(2 + AHEAD, -AHEAD)


def frame_times(
    model: Model,
    scene: Scene,
    motion: Motion,
    names: Iterable[str],
    *,
    folder: Path | None = None,
    store: ProgramStore | None = None,
) -> dict[str, float]:
    """Return milliseconds a frame of the variants `names`, single stream, output file not counted.

    Times known for this machine, model and version are read from `folder`, the others
    measured and put there.
    """
    path = _path(folder, model, scene)
    known, variants = _read(path), variants_of(model.params)
    with FrameProgress("measuring") as progress:
        for name in names:
            if name not in known:
                progress.say(f"{name}, of which the most is compiling")
                known[name] = measured_ms(model, scene, motion, variants[name], store=store)
                _write(path, known)
    return known


def measured_ms(
    model: Model, scene: Scene, motion: Motion, variant: Variant, *, store: ProgramStore | None = None
) -> float:
    """Return the median over chunks of a variant's milliseconds a frame, from pose to world vertices.

    Of the chunks in the middle of a rollout, when all of its stages are at work.
    """
    changed = apply_variant(model, variant)
    changed = changed._replace(
        config=replace(changed.config, rollout=replace(changed.config.rollout, chunk=FRAMES))
    )
    run = make_animator(changed, scene, detail=variant.detail, collision=variant.collision, store=store)
    wanted = FRAMES * CHUNKS
    back = max(2 * (len(motion.root) - 1), 1)  # a short motion goes to and fro
    rows = np.minimum(np.arange(wanted) % back, -np.arange(wanted) % back)
    taken = motion.rotations[: int(rows.max()) + 1]
    pieces = run(Motion(taken[rows], motion.root[rows], motion.fps))
    times, began = [], time.perf_counter()
    for piece in pieces:
        times.append((time.perf_counter() - began) / len(piece.V))
        began = time.perf_counter()
    return 1e3 * float(np.median(times[COUNTED]))


def _path(folder: Path | None, model: Model, scene: Scene) -> Path | None:
    folder = usable(folder)
    if folder is None:
        return None
    faces = 0 if scene.collider is None else len(scene.collider.faces)
    garment = (model.vertices, model.garment_hash)
    facts = (surroundings(), repr(model.config), sorted(model.params), garment, faces)
    return folder / f"times-{hashlib.sha256(repr(facts).encode()).hexdigest()[:32]}.json"


def _read(path: Path | None) -> dict[str, float]:
    try:
        known = json.loads(path.read_text(encoding="utf-8")) if path else {}
        return {str(name): float(ms) for name, ms in known.items()}
    except (OSError, ValueError, AttributeError):
        return {}


def _write(path: Path | None, known: dict[str, float]) -> None:
    if path is None:
        return
    with suppress(OSError):  # a full disk: measured again next time
        write_text(path, json.dumps(known, indent=1) + "\n")
        only_newest(path.parent, "times-*.json", KEPT)
