"""Alembic (`.abc`, Ogawa) through Blender: animated meshes both ways, as arrays.

Kept Python bindings of Alembic are not on PyPI; Blender's are (`blender.py`). Alembic knows neither unit nor
up axis. Only the file's times are read here: Blender does not tell them.
"""

import json
import shutil
import struct
import tempfile
import weakref
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.rates import rate_of_frame_time, stated_rate
from garment_jax.io.formats.blender import run_blender
from garment_jax.io.formats.mesh_cache import Frames, MeshCache, choose_mesh
from garment_jax.io.formats.polygon_fans import fan_corners
from garment_jax.storage.missing import not_a_file

_SCRIPT = Path(__file__).with_name("blender_alembic.py")
_SAMPLING = struct.Struct("<IdI")  # most samples, seconds a cycle, number of times in a cycle
_DATA = 1 << 63  # an Ogawa offset with this bit names data, without it a group
_MOST_FRAMES = 1_000_000  # nine hours at 30 frames a second; a file with more is damaged
_SECONDS, _SECONDS_A_FRAME = 600, 0.5  # of the clock; damage can make Blender read for ever
_ACYCLIC = 1e300  # seconds a cycle of a file whose times are all listed


class Timing(NamedTuple):
    """When an archive is sampled."""

    first: float  # seconds
    step: float  # seconds
    count: int


class AlembicMesh(NamedTuple):
    """A mesh to write; positions come from a PC2 file in Blender's axes."""

    name: str
    vertices: np.ndarray  # [n, 3] of any frame, Blender's axes
    faces: np.ndarray  # [f, 3]
    uv: np.ndarray | None  # [u, 2]
    faces_uv: np.ndarray | None  # [f, 3]
    cache: Path  # PC2


def read_alembic(
    path: str | Path, *, mesh: str | None = None, option: str = "--mesh", blender: str | Path | None = None
) -> MeshCache:
    """Open a mesh of an Alembic file: world positions in the file's own unit and axes.

    `mesh` is an object's name (with those above it, divided by "/", where names repeat); without it the only
    mesh, or the one named Garment, is taken. Blender writes the positions into a temporary file, which is
    read by windows. Raises `FileNotFoundError` without file or Blender, `ValueError` or `OSError` otherwise.
    """
    path = Path(path)
    timing = read_timing(path)
    folder = Path(tempfile.mkdtemp(prefix="garment-jax-"))
    try:
        frames = [(timing.first + k * timing.step) / timing.step for k in range(timing.count)]
        job = {
            "task": "read",
            "path": str(path.resolve()),
            "fps": 1 / timing.step,
            "at": frames,
            "mesh": None,
        }
        job |= {name: str(folder / file) for name, file in _FILES.items()}
        seconds = _SECONDS + _SECONDS_A_FRAME * timing.count
        _run(job, folder, blender, seconds)
        names = json.loads((folder / _FILES["names"]).read_text(encoding="utf-8"))
        chosen = choose_mesh(names, mesh, str(path), option)
        if len(names) > 1:  # an only mesh is there already
            _run(job | {"mesh": chosen}, folder, blender, seconds)
        return _collect(folder, timing)
    except BaseException as error:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(error, TimeoutError):
            raise OSError(
                f"{path} is damaged or too long ({str(error).rstrip('.')}); export it again, or cut it."
            ) from error
        raise


_FILES = {"names": "names.json", "vertices": "vertices.npy", "arrays": "arrays.npz"}


def _run(job: dict, folder: Path, blender: str | Path | None, seconds: float | None = None) -> None:
    (folder / "job.json").write_text(json.dumps(job), encoding="utf-8")
    run_blender(_SCRIPT, [str(folder / "job.json")], blender=blender, seconds=seconds)


def _collect(folder: Path, timing: Timing) -> MeshCache:
    """Return what Blender wrote; the folder goes when the vertices are no longer used."""
    stored = np.load(folder / _FILES["vertices"], mmap_mode="r")
    vertices = Frames(stored.shape, lambda start, stop: np.array(stored[start:stop]))
    weakref.finalize(vertices, shutil.rmtree, folder, ignore_errors=True)
    with np.load(folder / _FILES["arrays"]) as arrays:
        fans = fan_corners(arrays["counts"])
        faces, uv, faces_uv = arrays["corners"][fans], None, None
        if "uv" in arrays:
            uv, index = np.unique(arrays["uv"], axis=0, return_inverse=True)
            faces_uv = index.reshape(-1).astype(np.int32)[fans]
    fps = None if timing.count < 2 else stated_rate(rate_of_frame_time(timing.step))
    return MeshCache(vertices, faces, uv, faces_uv, fps, None, None)


def write_alembic(
    path: str | Path,
    meshes: list[AlembicMesh],
    *,
    fps: float,
    first_frame: int,
    count: int,
    folder: Path,
    blender: str | Path | None = None,
) -> None:
    """Write an Alembic file by Blender; frame k has the time `(first_frame + k) / fps` seconds.

    Positions in Blender's axes (x, -z, y) come out as (x, y, z). `folder` takes temporary files. Writes
    straight to `path`: the caller gives a temporary name. Raises as `run_blender`.
    """
    listed = []
    for mesh in meshes:
        arrays = folder / f"{mesh.name}.npz"
        if mesh.uv is None or mesh.faces_uv is None:
            np.savez(arrays, vertices=mesh.vertices, faces=mesh.faces)
        else:
            np.savez(arrays, vertices=mesh.vertices, faces=mesh.faces, uv=mesh.uv, faces_uv=mesh.faces_uv)
        listed.append({"name": mesh.name, "arrays": str(arrays), "cache": str(mesh.cache.resolve())})
    job: dict[str, Any] = {"task": "write", "path": str(Path(path).resolve()), "fps": fps, "meshes": listed}
    _run(job | {"first": first_frame, "frames": count}, folder, blender)
    if not Path(path).is_file():
        raise OSError(f"{path} could not be written by Blender; free some space or choose another folder.")


def read_timing(path: str | Path) -> Timing:
    """Return when an Alembic file is sampled, read from its Ogawa container.

    The sampling with the most samples counts. Raises `FileNotFoundError`, or `ValueError` for what is no
    finished Ogawa file, is cut short, or is unevenly sampled.
    """
    path = Path(path)
    if not path.is_file():
        raise not_a_file(path, "name an Alembic file")
    with path.open("rb") as file:
        head = file.read(16)
        if head.startswith(b"\x89HDF"):
            raise ValueError(
                f"{path} is Alembic's old HDF5 kind, which Blender cannot read; export as Ogawa."
            )
        if not head.startswith(b"Ogawa") or len(head) < 16:
            raise ValueError(f"{path} is no Alembic file: it does not begin with Ogawa; export it again.")
        if head[5] != 0xFF:
            raise ValueError(f"{path} was never finished by its writer; export it again.")
        try:
            data = _sampling_data(file, path.stat().st_size, struct.unpack("<Q", head[8:])[0])
            return _timing(data, path)
        except (struct.error, IndexError) as error:
            raise ValueError(f"{path} is cut short or damaged; copy or export it again.") from error


def _sampling_data(file: Any, size: int, root: int) -> bytes:
    """Return the archive's time samplings, the fifth child of the root group."""
    offset = _child(file, root, 4, size)
    if not offset & _DATA:
        raise IndexError("a group where data should be")
    if offset & ~_DATA >= size:  # the system refuses to go far beyond the end, in its own words
        raise IndexError("data beyond the end")
    file.seek(offset & ~_DATA)
    length = struct.unpack("<Q", file.read(8))[0]
    if length > size:
        raise IndexError("data longer than the file")
    return file.read(length)


def _child(file: Any, group: int, number: int, size: int) -> int:
    if group >= size:
        raise IndexError("a group beyond the end")
    file.seek(group)
    count = struct.unpack("<Q", file.read(8))[0]
    if number >= count:
        raise IndexError("too few children")
    file.seek(group + 8 + 8 * number)
    return struct.unpack("<Q", file.read(8))[0]


def _timing(data: bytes, path: Path) -> Timing:
    found, at = Timing(0.0, 1 / 24, 1), 0
    while at < len(data):
        samples, cycle, stored = _SAMPLING.unpack_from(data, at)
        times = struct.unpack_from(f"<{stored}d", data, at + _SAMPLING.size)
        at += _SAMPLING.size + 8 * stored
        if samples <= found.count:
            continue
        if samples > _MOST_FRAMES:
            raise ValueError(f"{path} announces {samples} samples; copy or export it again.")
        if stored == 1 and 0 < cycle < _ACYCLIC:
            found = Timing(times[0], cycle, samples)
        elif stored > 1 and np.ptp(np.diff(times)) < 1e-4 * (times[1] - times[0]):
            step = (times[-1] - times[0]) / (stored - 1)
            found = Timing(times[0], step, min(samples, stored) if cycle >= _ACYCLIC else samples)
        else:
            raise ValueError(f"{path} is sampled at uneven times; export it with one sample a frame.")
    return found
