"""Writing a USD stage of animated meshes: points, normals and extent per frame (extra `usd`)."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.io.formats.usd_library import load_pxr

_WRITER = "garment_jax"  # key of a layer's own data
_SAVED_EVERY = 32  # frames; a binary layer that is saved keeps no values in memory


class UsdMesh(NamedTuple):
    """What of a mesh does not change from frame to frame."""

    name: str  # of the prim
    faces: np.ndarray  # [f, 3]
    uv: np.ndarray | None  # [u, 2]
    faces_uv: np.ndarray | None  # [f, 3]
    colours: np.ndarray | None = None  # [n, 3] linear, of the vertices, or [1, 3] of all


def write_usd(
    path: str | Path,
    meshes: list[UsdMesh],
    frames: Iterable[list[tuple[np.ndarray, np.ndarray]]],
    *,
    fps: float,
    first_frame: float,
    count: int,
    unit: float,
    up: str,
) -> None:
    """Write a stage: `frames` yields of every mesh its points and unit normals, both `[n, 3]`.

    Frame k gets the time code `first_frame + k`. The suffix decides: `.usda` text, `.usdc` and `.usd` binary,
    `.usdz` a package. Points are in units of `unit` metres with the axis `up` ("Y" or "Z") upwards. Binary
    stages never hold more than a few frames in memory, text is held whole. Writes straight to `path`: the
    caller gives a temporary name. Raises `OSError` where the file could not be written.
    """
    pxr, path = load_pxr(), Path(path)
    packed = path.suffix.lower() == ".usdz"
    layer_path = path.with_name(path.stem + ".usdc") if packed else path
    try:
        stage = _new_stage(layer_path, pxr, fps, first_frame, count)
        pxr.UsdGeom.SetStageMetersPerUnit(stage, unit)
        pxr.UsdGeom.SetStageUpAxis(stage, getattr(pxr.UsdGeom.Tokens, up.lower()))
        prims = [_add_mesh(stage, mesh, pxr) for mesh in meshes]
        for k, posed in enumerate(frames):
            for prim, (points, normals) in zip(prims, posed, strict=True):
                _set_frame(prim, points, normals, first_frame + k, pxr)
            if layer_path.suffix != ".usda" and k % _SAVED_EVERY == _SAVED_EVERY - 1:
                stage.GetRootLayer().Save()
        stage.GetRootLayer().Save()
        if packed and not pxr.UsdUtils.CreateNewUsdzPackage(pxr.Sdf.AssetPath(str(layer_path)), str(path)):
            raise OSError(f"{path} could not be packed; write a .usdc instead.")
    except pxr.Tf.ErrorException as error:
        raise OSError(f"{path} could not be written; free some space or choose another folder.") from error
    finally:
        if packed:
            layer_path.unlink(missing_ok=True)


def _new_stage(path: Path, pxr: Any, fps: float, first_frame: float, count: int) -> Any:
    """Return an empty stage with its times and the default prim /Clip."""
    arguments = {"format": "usda" if path.suffix.lower() == ".usda" else "usdc"}
    layer = pxr.Sdf.Layer.CreateNew(str(path), args=arguments)
    stage = pxr.Usd.Stage.Open(layer)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(first_frame)
    stage.SetEndTimeCode(first_frame + count - 1)
    root = pxr.UsdGeom.Xform.Define(stage, "/Clip").GetPrim()
    pxr.Usd.ModelAPI(root).SetKind(pxr.Kind.Tokens.component)
    stage.SetDefaultPrim(root)
    layer.customLayerData = {_WRITER: True}
    return stage


def _add_mesh(stage: Any, mesh: UsdMesh, pxr: Any) -> Any:
    """Define a mesh below the default prim: triangles, texture coordinates, no subdivision."""
    geometry = pxr.UsdGeom.Mesh.Define(stage, f"/Clip/{mesh.name}")
    pxr.Usd.ModelAPI(geometry.GetPrim()).SetKind(pxr.Kind.Tokens.subcomponent)
    geometry.CreateSubdivisionSchemeAttr(pxr.UsdGeom.Tokens.none)
    geometry.CreateFaceVertexCountsAttr(pxr.Vt.IntArray(len(mesh.faces), 3))
    geometry.CreateFaceVertexIndicesAttr(_ints(mesh.faces, pxr))
    geometry.CreateDoubleSidedAttr(True)
    geometry.SetNormalsInterpolation(pxr.UsdGeom.Tokens.vertex)
    if mesh.uv is not None and mesh.faces_uv is not None:
        kind, varying = pxr.Sdf.ValueTypeNames.TexCoord2fArray, pxr.UsdGeom.Tokens.faceVarying
        st = pxr.UsdGeom.PrimvarsAPI(geometry).CreatePrimvar("st", kind, varying)
        st.Set(pxr.Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.uv, np.float32)))
        st.SetIndices(_ints(mesh.faces_uv, pxr))
    if mesh.colours is not None:
        tokens = pxr.UsdGeom.Tokens
        shown = geometry.CreateDisplayColorPrimvar(
            tokens.constant if len(mesh.colours) == 1 else tokens.vertex
        )
        shown.Set(pxr.Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(mesh.colours, np.float32)))
    return geometry


def _ints(values: np.ndarray, pxr: Any) -> Any:
    return pxr.Vt.IntArray.FromNumpy(np.ascontiguousarray(values.reshape(-1), np.int32))


def _set_frame(geometry: Any, points: np.ndarray, normals: np.ndarray, code: float, pxr: Any) -> None:
    points = np.ascontiguousarray(points, np.float32)
    box = np.stack([points.min(axis=0), points.max(axis=0)])
    geometry.GetPointsAttr().Set(pxr.Vt.Vec3fArray.FromNumpy(points), code)
    geometry.GetNormalsAttr().Set(
        pxr.Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(normals, np.float32)), code
    )
    geometry.GetExtentAttr().Set(pxr.Vt.Vec3fArray.FromNumpy(box), code)
