"""Animated meshes of other programs: one structure for all formats, and `read_cache`, which picks the reader.

Values are the file's own: its unit, its axes, its vertex order. Nothing is converted here.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.formats.damage import reads_foreign

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
SUFFIXES = (".pc2", ".mdd", ".abc", *USD_SUFFIXES)


class MeshCache(NamedTuple):
    """A mesh that moves while its triangles stay (the file's own unit and axes)."""

    vertices: Any  # [t, n, 3] float32, or what has such a shape and is sliced by frames (`Frames`)
    faces: np.ndarray | None  # [f, 3] int32, polygons as fans; None where the format has none
    uv: np.ndarray | None  # [u, 2] float32
    faces_uv: np.ndarray | None  # [f, 3] int32 indices into uv
    fps: float | None  # frames a second, None where the format does not say
    unit: float | None  # metres per unit of length, None where the format does not say
    up: str | None  # "Y" or "Z", None where the format does not say
    frames_a_sample: float = 1.0  # of a scene whose rate the file does not say; `vertices` are its samples
    notes: tuple[str, ...] = ()  # what of the file was left out, a phrase each


def files_named_in(path: Path) -> tuple[Path, ...]:
    """Return the files that a file names as parts of itself: a glTF's buffers, a USD stage's layers."""
    suffix = path.suffix.lower()
    if suffix == ".gltf":
        from garment_jax.formats.gltf_container import buffer_files

        return buffer_files(path)
    if suffix in USD_SUFFIXES:
        from garment_jax.formats.usd import layer_files

        return layer_files(path)
    return ()


def check_length(size: int, head: int, frames: int, points: int, path: Path, kind: str) -> tuple[str, ...]:
    """Return a note where whole frames follow those that a point cache announces: left out, as rows of BVH.

    Raises `ValueError` for any other number of bytes `size`, of which `head` are no positions.
    """
    expected = head + 12 * frames * points
    extra, rest = divmod(size - expected, 12 * points)
    if extra < 0 or rest:
        raise ValueError(
            f"{path} has {size} bytes, but as {kind} it announces {frames} frames of {points} points, which "
            f"take {expected}; copy or export it again."
        )
    more = "1 frame" if extra == 1 else f"{extra} frames"
    verb = "is" if extra == 1 else "are"
    return (f"{more} more than the {frames} announced {verb} left out",) if extra else ()


class Frames:
    """Vertices `[t, n, 3]` float32 that are read when they are sliced by frames, and never all at once.

    `read(start, stop)` returns frames `start … stop - 1`, `[k, n, 3]`; `keep` is held as long as this is.
    """

    dtype = np.dtype(np.float32)
    ndim = 3

    def __init__(
        self, shape: tuple[int, int, int], read: Callable[[int, int], np.ndarray], *, keep: Any = None
    ) -> None:
        self.shape = shape
        self._read = read
        self._keep = keep

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, frames: int | slice) -> np.ndarray:
        """Return one frame `[n, 3]`, or the frames of a slice `[k, n, 3]`."""
        if isinstance(frames, slice):
            start, stop, step = frames.indices(len(self))
            if step != 1:
                chosen = range(start, stop, step)
                none = np.zeros((0, *self.shape[1:]), np.float32)
                return np.stack([self[k] for k in chosen]) if len(chosen) else none
            return self._read(start, max(start, stop))
        if not -len(self) <= frames < len(self):
            raise IndexError(f"frame {frames} of {len(self)}")
        return self._read(frames % len(self), frames % len(self) + 1)[0]


@reads_foreign
def read_cache(
    path: str | Path, *, mesh: str | None = None, option: str = "--mesh", blender: str | None = None
) -> MeshCache:
    """Open an animated mesh: `.pc2`, `.mdd`, `.usd(a|c|z)`, `.abc`, or a folder of `.obj` or `.ply` files.

    `mesh` names one of several meshes (USD: a prim's path or name, Alembic: an object's name), `option` is
    how the command calls it; `blender`
    as in `formats.blender.find_blender`, which only Alembic needs. Raises `FileNotFoundError`, `OSError`
    (damaged) or `ValueError` (what does not fit), each in one sentence.
    """
    from garment_jax.formats import alembic, mdd, obj_sequence, pc2, usd

    path = Path(path)
    suffix = path.suffix.lower()
    if not path.exists():
        raise FileNotFoundError(f"{path} is not there; name a file ({' '.join(SUFFIXES)}) or a folder.")
    if path.is_dir():
        return obj_sequence.read_folder(path)
    if suffix == ".pc2":
        return pc2.read_pc2(path)
    if suffix == ".mdd":
        return mdd.read_mdd(path)
    if suffix in USD_SUFFIXES:
        return usd.read_usd(path, mesh=mesh, option=option)
    if suffix == ".abc":
        return alembic.read_alembic(path, mesh=mesh, option=option, blender=blender)
    raise ValueError(
        f"{path}: {suffix or 'a file without an ending'} is no animated mesh that can be read; give "
        f"{', '.join(SUFFIXES)} or a folder of OBJ or PLY files, one a frame."
    )


def fan_corners(counts: np.ndarray) -> np.ndarray:
    """Return the corners `[f, 3]` int64 of the triangle fans of polygons with `counts` `[p]` corners.

    Indices into the polygons' corners, one polygon after the other. Those with fewer than 3 give none.
    """
    counts = np.asarray(counts, np.int64)
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(np.cumsum(counts) - counts, triangles)
    k = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([first, first + k + 1, first + k + 2], axis=1)


def choose_mesh(names: list[str], wanted: str | None, where: str, option: str = "--mesh") -> str:
    """Return the mesh to read: the one `wanted` (a path or its last part), the only one, or the garment.

    A name's parts are divided by "/". Raises `ValueError` with the names, and the `option` that takes one,
    where that leaves none or several.
    """
    listed = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
    if not names:
        raise ValueError(f"{where} holds no mesh; export the garment as a polygon mesh.")
    target = wanted or (names[0].rsplit("/")[-1] if len(names) == 1 else "garment")
    exact = [name for name in names if name == target]
    found = exact or [name for name in names if name.rsplit("/", 1)[-1].lower() == target.lower()]
    if len(found) == 1:
        return found[0]
    if wanted:
        raise ValueError(f"{where} has {len(found)} meshes named {wanted!r}; {option} takes one of {listed}.")
    raise ValueError(
        f"{where} holds several meshes; choose one with {option} NAME: {listed}, or call it Garment."
    )
