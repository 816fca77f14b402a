"""The part of `io/formats/usd.py` that runs in a process of its own: a stage becomes arrays in a folder.

One changed byte can end Pixar's reader with a segmentation fault, and a short file can ask for any memory, so
this process sets itself limits before it loads the library, and its parent makes a sentence of its end.
"""

import json
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.body.rates import rate_of_frame_time, stated_rate
from garment_jax.io.formats.limits import check_growth
from garment_jax.io.formats.mesh_cache import choose_mesh
from garment_jax.io.formats.polygon_fans import fan_corners
from garment_jax.io.formats.usd_library import load_pxr

_MOST_FRAMES = 1_000_000  # nine hours at 30 frames a second; a file with more is damaged
_MOST_LAYERS = 256
_CODES = 0.1  # time codes a sample; fewer are seconds
_DENSEST = 4
_MEMORY, _MEMORY_A_BYTE = (
    400 * 2**20,
    12,
)  # bytes, of which the library takes a third; and per byte of the file
_SECONDS, _SECONDS_A_BYTE = 60, 1e-6


class _Times(NamedTuple):
    """The evenly spaced time codes at which a mesh is read."""

    first: float
    step: float
    count: int


def main(folder: str) -> None:
    """Do what `job.json` in the folder asks; leave the results there, or `refused.json`."""
    job = json.loads((Path(folder) / "job.json").read_text(encoding="utf-8"))
    path = Path(os.fsdecode(bytes.fromhex(job["path"])))
    try:
        _limit(path.stat().st_size)
        stage = open_stage(path, load_pxr())
        if job["task"] == "layers":
            _write(folder, {"layers": [os.fsencode(file).hex() for file in _files(stage, path)]})
        else:
            read_mesh(stage, path, Path(folder), mesh=job["mesh"], option=job["option"])
    except MemoryError:
        _write(folder, {"kind": "ValueError", "text": f"{path} does not fit into memory; cut it into clips."})
    except Exception as error:
        sentence = type(error) in (ValueError, OSError, FileNotFoundError)
        kind = "ValueError" if isinstance(error, ValueError) and sentence else "OSError"
        _write(folder, {"kind": kind, "text": str(error) if sentence else damaged(path)})


def damaged(path: Path, reason: str = "") -> str:
    """Return the sentence for what the library cannot read."""
    return f"{path} is damaged or no USD file{reason}; copy or export it again."


def _write(folder: str | Path, content: dict) -> None:
    (Path(folder) / "answer.json").write_text(json.dumps(content), encoding="utf-8")


def _limit(size: int) -> None:
    """Bound memory and time of this process, where the system can."""
    with suppress(ImportError):
        import resource

        for kind, most in (
            (resource.RLIMIT_DATA, _MEMORY + _MEMORY_A_BYTE * size),
            (resource.RLIMIT_CPU, int(_SECONDS + _SECONDS_A_BYTE * size)),
            (resource.RLIMIT_CORE, 0),
        ):
            with suppress(ValueError, OSError):
                resource.setrlimit(kind, (most, most))


def open_stage(path: Path, pxr: Any) -> Any:
    """Return the stage, or raise `ValueError` for one that names files outside its own folder, `OSError`."""
    try:
        _check_layers(path, pxr)
        stage = pxr.Usd.Stage.Open(str(path))
    except pxr.Tf.ErrorException as error:
        raise OSError(damaged(path)) from error
    if stage is None:
        raise OSError(damaged(path))
    for file in _files(stage, path):
        _check_inside(str(file), path)
    return stage


def _files(stage: Any, path: Path) -> list[Path]:
    """Return the files of a stage's other layers, sorted."""
    used = {Path(layer.realPath.split("[")[0]).resolve() for layer in stage.GetUsedLayers() if layer.realPath}
    return sorted(file for file in used - {path.resolve()} if file.is_file())


def _check_layers(path: Path, pxr: Any) -> None:
    """Look at each layer before anything is composed of it: what it names must lie in the stage's folder."""
    waiting, seen = [str(path)], set()
    while waiting:
        name = waiting.pop()
        layer = pxr.Sdf.Layer.FindOrOpen(name)
        if layer is None:
            if not seen:
                raise OSError(damaged(path))
            continue  # the library leaves out what is not there
        seen.add(name)
        if len(seen) > _MOST_LAYERS:
            raise ValueError(f"{path} is made of more than {_MOST_LAYERS} files; flatten it into one.")
        for asset in _assets(layer):
            if asset.startswith("`") or "://" in asset:
                raise ValueError(f"{path} names {asset!r}, which is no file beside it; flatten it into one.")
            found = layer.ComputeAbsolutePath(asset)
            if not os.path.isabs(found):  # to be searched for: beside the layer first
                found = os.path.join(os.path.dirname(layer.realPath), asset)
            _check_inside(found, path, asset)
            if found not in seen and "#" not in found:
                waiting.append(found)


def _check_inside(file: str, path: Path, asset: str = "") -> None:
    folder = path.parent.resolve()
    if not Path(file.split("[")[0]).resolve().is_relative_to(folder):
        raise ValueError(
            f"{path} names {asset or file!r}, outside its own folder, which is not read; put it beside "
            f"{path.name}, or flatten both into one file."
        )


def _assets(layer: Any) -> Iterator[str]:
    """Yield what a layer names as parts of itself: sublayers, references, payloads, value clips."""
    yield from filter(None, layer.GetCompositionAssetDependencies())
    clips: list[Any] = []

    def visit(at: Any) -> None:
        if at.IsPrimPath() or at.IsPrimVariantSelectionPath():
            spec = layer.GetObjectAtPath(at)
            if spec is not None and spec.HasInfo("clips"):
                clips.append(spec.GetInfo("clips"))

    layer.Traverse("/", visit)
    for found in clips:
        for one in found.values():
            for key in ("assetPaths", "manifestAssetPath", "templateAssetPath"):
                value = one.get(key) or []
                listed = [value] if isinstance(value, str) or hasattr(value, "path") else value
                yield from (str(getattr(asset, "path", asset)) for asset in listed)


def read_mesh(stage: Any, path: Path, folder: Path, *, mesh: str | None, option: str) -> None:
    """Write a mesh's frames, triangles and texture coordinates, and what the stage says of itself."""
    pxr = load_pxr()
    chosen = choose_mesh(_meshes(stage, path, pxr), mesh, str(path), option)
    where = f"{path} {chosen}"
    geometry = pxr.UsdGeom.Mesh(stage.GetPrimAtPath(chosen))
    times = _times(geometry, pxr, where)
    start = pxr.Usd.TimeCode(times.first)
    size = len(_value(geometry, start, where))
    bytes_read = sum(file.stat().st_size for file in (path, *_files(stage, path)))
    if times.count * size * 12 > _DENSEST * bytes_read:  # points are stored as they are, equal ones once
        check_growth(times.count * size * 12, bytes_read, f"{times.count} frames of {size} points", path)
    faces, corners = _triangles(geometry, pxr, start, where)
    uv, faces_uv = _texture(geometry, pxr, start, faces, corners)
    if len(faces) and (faces.min() < 0 or faces.max() >= size):
        raise ValueError(f"{where}: a face names a point that is not among its {size}; export it again.")
    with (folder / "vertices.f4").open("wb") as file:
        for k in range(times.count):
            points = _points(geometry, pxr.Usd.TimeCode(times.first + k * times.step), size, where)
            file.write(points.astype("<f4", copy=False).tobytes())
    texture = {} if uv is None or faces_uv is None else {"uv": uv, "faces_uv": faces_uv}
    with (folder / "arrays.npz").open("wb") as file:
        np.savez(file, faces=faces, **texture)  # pyright: ignore[reportArgumentType]
    # the library answers 24 where the stage says nothing; such a stage has numbered frames, and no rate
    seconds = times.step / stage.GetTimeCodesPerSecond()
    rated = any(stage.HasAuthoredMetadata(f"{name}PerSecond") for name in ("timeCodes", "frames"))
    authored = pxr.UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    _write(
        folder,
        {
            "shape": (times.count, size, 3),
            "fps": stated_rate(rate_of_frame_time(seconds)) if rated and times.count > 1 else None,
            # codes that are no seconds number the frames of a scene
            "frames_a_sample": times.step if not rated and times.step > _CODES else 1.0,
            "unit": float(pxr.UsdGeom.GetStageMetersPerUnit(stage)) if authored else None,
            "up": str(pxr.UsdGeom.GetStageUpAxis(stage)) if stage.HasAuthoredMetadata("upAxis") else None,
        },
    )


def _meshes(stage: Any, path: Path, pxr: Any) -> list[str]:
    """Return the paths of the active meshes, those inside instances, too."""
    prims = pxr.Usd.PrimRange.Stage(stage, pxr.Usd.TraverseInstanceProxies())
    found = [str(prim.GetPath()) for prim in prims if prim.IsA(pxr.UsdGeom.Mesh)]
    idle = [str(prim.GetPath()) for prim in stage.TraverseAll() if not prim.IsActive()]
    if not found and idle:
        raise ValueError(f"{path} holds no mesh that is active; activate {', '.join(idle[:3])}.")
    return found


def _times(geometry: Any, pxr: Any, where: str) -> _Times:
    """Return when the mesh is sampled: its points' times, or its transforms' where the points stand still."""
    samples = geometry.GetPointsAttr().GetTimeSamples()
    if len(samples) < 2:
        samples = _transform_times(geometry, pxr) or samples
    if not samples:
        if not geometry.GetPointsAttr().Get():
            raise ValueError(f"{where} has no points; export the mesh itself, not a reference to it.")
        return _Times(0.0, 1.0, 1)
    times = np.array(samples, np.float64)
    if len(times) == 1:
        return _Times(float(times[0]), 1.0, 1)
    step = float(np.diff(times).min())
    steps = (times - times[0]) / step
    if np.abs(steps - np.rint(steps)).max() > 1e-3 or steps[-1] >= _MOST_FRAMES:
        raise ValueError(
            f"{where}: time samples are unevenly spaced ({step:g} to {np.diff(times).max():g} time codes); "
            "export one sample a frame."
        )
    count = round(steps[-1]) + 1
    return _Times(float(times[0]), float((times[-1] - times[0]) / (count - 1)), count)


def _transform_times(geometry: Any, pxr: Any) -> list[float]:
    """Return the time samples of the transforms above the mesh and its own, sorted."""
    found: set[float] = set()
    prim = geometry.GetPrim()
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(pxr.UsdGeom.Xformable):
            found |= set(pxr.UsdGeom.Xformable(prim).GetTimeSamples())
        prim = prim.GetParent()
    return sorted(found)


def _triangles(geometry: Any, pxr: Any, start: Any, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles as point indices and as corner numbers, both `[f, 3]` int32."""
    attributes = geometry.GetFaceVertexCountsAttr(), geometry.GetFaceVertexIndicesAttr()
    for attribute in attributes:
        times = attribute.GetTimeSamples()
        if len(times) > 1 and any(attribute.Get(t) != attribute.Get(times[0]) for t in times[1:]):
            raise ValueError(f"{where}: the triangles change over time; export a mesh of constant topology.")
    counts, indices = (np.array(a.Get(start) or [], np.int64) for a in attributes)
    if counts.sum() != len(indices) or (counts < 0).any():
        raise ValueError(
            f"{where}: faceVertexCounts announce {counts.sum()} corners, there are {len(indices)}; "
            "export it again."
        )
    corners = fan_corners(counts).astype(np.int32)
    if geometry.GetOrientationAttr().Get() == pxr.UsdGeom.Tokens.leftHanded:
        corners = corners[:, ::-1]
    return indices.astype(np.int32)[corners], corners


def _texture(
    geometry: Any, pxr: Any, start: Any, faces: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return `uv` and `faces_uv` of primvars:st, or of the first primvar of texture coordinates."""
    primvars = pxr.UsdGeom.PrimvarsAPI(geometry)
    named = [primvars.GetPrimvar("st")] if primvars.HasPrimvar("st") else []
    typed = [p for p in primvars.GetPrimvars() if str(p.GetTypeName()).startswith("texCoord2")]
    for primvar in named + typed:
        values = np.array(primvar.Get(start) or [], np.float32)
        kind = primvar.GetInterpolation()
        places = {pxr.UsdGeom.Tokens.faceVarying: corners, pxr.UsdGeom.Tokens.vertex: faces}.get(kind)
        if places is None or values.ndim != 2 or values.shape[1] != 2:
            continue
        indices = np.array(primvar.GetIndices(start) or np.arange(len(values)), np.int32)
        if places.size and places.max() < len(indices) and indices.min() >= 0 and indices.max() < len(values):
            return values, indices[places]
    return None, None


def _value(geometry: Any, code: Any, where: str) -> Any:
    """Return the points at a time code; `ValueError` where they are blocked there."""
    found = geometry.GetPointsAttr().Get(code)
    if found is None:
        raise ValueError(
            f"{where}: its points are blocked at time code {code.GetValue():g}; export the mesh with points "
            "in every frame."
        )
    return found


def _points(geometry: Any, code: Any, size: int, where: str) -> np.ndarray:
    """Return the mesh's points at a time code in world space, `[size, 3]`."""
    points = np.array(_value(geometry, code, where), np.float32).reshape(-1, 3)
    if len(points) != size:
        raise ValueError(
            f"{where}: time code {code.GetValue():g} has {len(points)} points, the first {size}; export a "
            "mesh of constant topology."
        )
    matrix = np.array(geometry.ComputeLocalToWorldTransform(code))  # for row vectors
    return points if np.array_equal(matrix, np.eye(4)) else points @ matrix[:3, :3] + matrix[3, :3]
