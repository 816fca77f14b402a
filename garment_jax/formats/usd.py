"""USD: a mesh with time samples, read and written through Pixar's own library (extra `usd`).

Only meshes are read: their points over time in world space, triangles and texture coordinates.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.formats.mesh_cache import Frames, MeshCache, choose_mesh, fan_corners

_MOST_FRAMES = 1_000_000  # nine hours at 30 frames a second; a file with more is damaged


class _Times(NamedTuple):
    """The evenly spaced time codes at which a mesh is read."""

    first: float
    step: float
    count: int


def load_pxr() -> Any:
    """Return the module `pxr` with its parts, or raise `ValueError` with the command that installs it."""
    try:
        import pxr
        from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt  # noqa: F401 - loaded for pxr.X
    except ImportError as error:
        raise ValueError(
            "USD files need Pixar's library; install it with `pip install -e '.[usd]'`."
        ) from error
    return pxr


def read_usd(path: str | Path, *, mesh: str | None = None, option: str = "--mesh") -> MeshCache:
    """Open a mesh of a USD stage (`.usd`, `.usda`, `.usdc`, `.usdz`); world space, the stage's unit and axes.

    `mesh` is a prim's path or name; without it the only mesh, or the one named Garment, is taken. Transforms
    above the mesh are applied. Where samples are unevenly spaced but lie on a grid, USD interpolates. Raises
    `FileNotFoundError`, `OSError` (damaged) or `ValueError` (triangles that change, uneven times).
    """
    pxr = load_pxr()
    path = Path(path)
    stage = _open(path, pxr)
    meshes = [str(prim.GetPath()) for prim in stage.TraverseAll() if prim.IsA(pxr.UsdGeom.Mesh)]
    chosen = choose_mesh(meshes, mesh, str(path), option)
    geometry = pxr.UsdGeom.Mesh(stage.GetPrimAtPath(chosen))
    times = _times(geometry, pxr, f"{path} {chosen}")
    start = pxr.Usd.TimeCode(times.first)
    faces, corners = _triangles(geometry, pxr, start, f"{path} {chosen}")
    uv, faces_uv = _texture(geometry, pxr, start, faces, corners)
    size = len(geometry.GetPointsAttr().Get(start))
    if len(faces) and (faces.min() < 0 or faces.max() >= size):
        raise ValueError(
            f"{path} {chosen}: a face names a point that is not among its {size}; export it again."
        )

    def read(first: int, stop: int) -> np.ndarray:
        codes = [pxr.Usd.TimeCode(times.first + k * times.step) for k in range(first, stop)]
        frames = np.empty((len(codes), size, 3), np.float32)
        for k, code in enumerate(codes):
            frames[k] = _points(geometry, code, size, f"{path} {chosen}")
        return frames

    vertices = Frames((times.count, size, 3), read, keep=stage)
    fps = stage.GetTimeCodesPerSecond() / times.step if times.count > 1 else None
    authored = pxr.UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    unit = float(pxr.UsdGeom.GetStageMetersPerUnit(stage)) if authored else None
    up = str(pxr.UsdGeom.GetStageUpAxis(stage)) if stage.HasAuthoredMetadata("upAxis") else None
    return MeshCache(vertices, faces, uv, faces_uv, fps, unit, up)


def layer_files(path: Path) -> tuple[Path, ...]:
    """Return the files of a stage's other layers (sublayers, references), sorted; raises as `read_usd`."""
    stage = _open(path, load_pxr())
    used = {Path(layer.realPath).resolve() for layer in stage.GetUsedLayers() if layer.realPath}
    return tuple(sorted(file for file in used - {path.resolve()} if file.is_file()))


def _open(path: Path, pxr: Any) -> Any:
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there; name a USD file.")
    try:
        stage = pxr.Usd.Stage.Open(str(path))
    except pxr.Tf.ErrorException as error:
        raise OSError(f"{path} is damaged or no USD file; copy or export it again.") from error
    if stage is None:
        raise OSError(f"{path} is damaged or no USD file; copy or export it again.")
    return stage


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


def _points(geometry: Any, code: Any, size: int, where: str) -> np.ndarray:
    """Return the mesh's points at a time code in world space, `[size, 3]`."""
    points = np.array(geometry.GetPointsAttr().Get(code), np.float32).reshape(-1, 3)
    if len(points) != size:
        raise ValueError(
            f"{where}: time code {code.GetValue():g} has {len(points)} points, the first {size}; export a "
            "mesh of constant topology."
        )
    matrix = np.array(geometry.ComputeLocalToWorldTransform(code))  # for row vectors
    return points if np.array_equal(matrix, np.eye(4)) else points @ matrix[:3, :3] + matrix[3, :3]
