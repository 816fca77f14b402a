"""A sequence file becomes an animated GLB: the garment by morph targets, the body by its skin.

A morph target is the way from the first frame to another one, with its normals; linear keys blend from each
frame to the next. Every frame costs 24 bytes a vertex there. Graphics cards need not offer more than 256
layers of a texture, in which viewers in a browser keep the targets: that is the usual limit. The body is
animated by its joints; a vertex has its four largest weights, as viewers read no more.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.evaluation.colours import garment_colours
from garment_jax.evaluation.pair import read_finite
from garment_jax.exporters.glb_body import add_body
from garment_jax.exporters.glb_document import add_channel, new_document, smooth_normals, tidy
from garment_jax.io.formats.gltf_writer import INDICES, VERTICES, GlbWriter
from garment_jax.io.sequence import Sequence
from garment_jax.structs import Garment

MOST_TARGETS = 256
_WINDOW = 64  # frames of the sequence in memory


class GlbReport(NamedTuple):
    """What was written."""

    frames: int
    vertices: int  # of the garment, with one for each of a seam vertex's UVs
    size: int  # bytes
    body_error: float | None  # metres a body vertex is off at most for want of small weights; None: no body


def write_glb(
    sequence: Sequence,
    path: str | Path,
    *,
    scale: float = 1.0,
    up: str = "Y",
    fps: float | None = None,
    start: int = 0,
    stop: int | None = None,
    every: int = 1,
    body: bool = True,
    most_targets: int = MOST_TARGETS,
) -> GlbReport:
    """Write frames `start, start + every, … < stop` of a sequence as an animated GLB.

    Frame `start` plays at second 0 and frame f at (f - start) / `fps` (default: the clip's). The mesh
    "garment" has a vertex for every pair of vertex and UV; its `extras.garment_vertex` lists the clip's
    vertex for each. `body=False` leaves the body out. Raises `ValueError` for another unit or axis than
    metres and Y up, frames out of range, and more than `most_targets` morph targets.
    """
    path = Path(path)
    _check_metres(scale, up, path)
    frames = _frames(sequence, start, stop, every)
    _check_targets(frames, most_targets, path)
    rate = sequence.fps if fps is None else fps
    if not 0 < rate < 10_000:
        raise ValueError(f"fps={rate} must lie between 0 and 10000 frames a second.")
    (cloth,) = garment_colours([str(sequence.attributes.get("kind", ""))])
    document = new_document(sequence.name, frames, rate, cloth)
    with GlbWriter(path) as writer:
        times = writer.add((np.arange(len(frames)) * (every / rate)).astype(np.float32), bounds=True)
        vertices = _add_garment(writer, document, sequence, frames, times)
        error = add_body(writer, document, sequence, frames, times) if body else None
        tidy(document)
        return GlbReport(len(frames), vertices, writer.finish(document), error)


def split_vertices(garment: Garment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the garment's vertex `[m]`, UV `[m, 2]` and faces `[f, 3]` with one vertex a (vertex, UV) pair.

    In the order of the vertices, then of their UVs; a vertex without a face gets one with the UV 0. UVs count
    from the top, as glTF's do and ours do not.
    """
    n, u = len(garment.template), len(garment.uv)
    pairs, faces = np.unique(garment.faces.astype(np.int64) * u + garment.faces_uv, return_inverse=True)
    loose = np.setdiff1d(np.arange(n), garment.faces)
    vertex = np.concatenate([pairs // u, loose])
    uv = np.concatenate([garment.uv[pairs % u], np.zeros((len(loose), 2))])
    order = np.argsort(vertex, kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    turned = np.stack([uv[order, 0], 1 - uv[order, 1]], axis=1)
    return vertex[order], turned.astype(np.float32), place[faces].reshape(-1, 3)


def _check_metres(scale: float, up: str, path: Path) -> None:
    if scale != 1.0 or up != "Y":
        unit = {100.0: "cm", 1000.0: "mm"}.get(scale, "other than m")
        given = f"--out-unit {unit}" if scale != 1.0 else f"--out-up {up}"
        raise ValueError(
            f"{path}: {given} is refused, since glTF fixes metres and Y up; programs that import it turn it "
            "to their own."
        )


def _frames(sequence: Sequence, start: int, stop: int | None, every: int) -> range:
    stop = sequence.frames if stop is None else stop
    if every < 1 or not 0 <= start < stop <= sequence.frames:
        raise ValueError(
            f"{sequence.path}: frames {start} … {stop} by {every} asked of {sequence.frames}; choose "
            f"0 <= start < stop <= {sequence.frames} and every >= 1."
        )
    return range(start, stop, every)


def _check_targets(frames: range, most: int, path: Path) -> None:
    if len(frames) - 1 > most:
        step = frames.step * -(-(len(frames) - 1) // most)
        raise ValueError(
            f"{path}: {len(frames)} frames need {len(frames) - 1} morph targets and viewers take {most}; "
            f"take every {step}th frame, or part of the clip."
        )


def _add_garment(
    writer: GlbWriter, document: dict[str, Any], sequence: Sequence, frames: range, times: int
) -> int:
    """Write the garment's first frame and the others as its morph targets; return its vertices."""
    vertex, uv, faces = split_vertices(sequence.scene.garment)
    normals_of = smooth_normals(sequence.scene.garment.faces)
    posed = _posed(sequence, frames)
    first = next(posed)
    up = normals_of(first)
    primitive: dict[str, Any] = {
        "attributes": {
            "POSITION": writer.add(first[vertex], target=VERTICES, bounds=True),
            "NORMAL": writer.add(up[vertex], target=VERTICES),
            "TEXCOORD_0": writer.add(uv, target=VERTICES),
        },
        "indices": writer.add(faces.astype(np.uint32).reshape(-1), target=INDICES),
        "material": 0,
    }
    targets = [
        {
            "POSITION": writer.add((V - first)[vertex], target=VERTICES, bounds=True),
            "NORMAL": writer.add((normals_of(V) - up)[vertex], target=VERTICES),
        }
        for V in posed
    ]
    extras: dict[str, Any] = {"garment_vertex": vertex.tolist()}
    if targets:
        primitive["targets"] = targets
        extras["targetNames"] = [f"frame {frame}" for frame in frames[1:]]
        weights = writer.add(np.eye(len(frames), dtype=np.float32)[:, 1:].reshape(-1))
        add_channel(document, times, weights, 0, "weights")
    document["meshes"].append({"name": "garment", "primitives": [primitive], "extras": extras})
    document["nodes"].append({"name": "garment", "mesh": 0})
    document["scenes"][0]["nodes"].append(0)
    return len(vertex)


def _posed(sequence: Sequence, frames: range) -> Iterator[np.ndarray]:
    """Yield the garment `[n, 3]` of every frame, reading by windows."""
    count = max(1, _WINDOW // frames.step)
    for first in range(0, len(frames), count):
        part = frames[first : first + count]
        yield from read_finite(sequence, part[0], part[-1] + 1)[:: frames.step]
