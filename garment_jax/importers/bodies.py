"""Any rigged body as the package has it: metres, Y up, facing +Z, its rest pose the canonical one."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.joint_names import side_pairs
from garment_jax.importers.units import metres_per_unit, to_metres_y_up
from garment_jax.io.formats.damage import reads_foreign
from garment_jax.io.formats.fbx import reads_fbx
from garment_jax.io.formats.gltf import read_body
from garment_jax.io.formats.smpl import is_smpl, read_smpl
from garment_jax.io.npz import load_body
from garment_jax.io.sequence import open_sequence
from garment_jax.io.validation import LARGEST, SMALLEST
from garment_jax.storage.missing import not_a_file
from garment_jax.structs import RiggedBody

GLTF = (".glb", ".gltf")
SUFFIXES = (".npz", ".pkl", *GLTF, ".fbx", ".h5")
_FACING = 0.5  # part of the distance between left and right joints that must be along +X


class LoadedBody(NamedTuple):
    """A body and where it came from."""

    body: RiggedBody
    origin: np.ndarray  # [3] float64 metres: where the file's own origin is in the canonical pose
    notes: tuple[str, ...]  # what the user is to know, a phrase each


@reads_fbx
@reads_foreign
def read_any_body(
    path: str | Path,
    *,
    betas: np.ndarray | None = None,
    unit: float | str | None = None,
    up: str | None = None,
    mesh: str | None = None,
    skeleton: str | None = None,
    part: str = "",
) -> LoadedBody:
    """Read a rigged body: our `.npz`, a sequence file's, SMPL's `.npz` or `.pkl`, glTF's or FBX's.

    `betas` `[k]` is the shape of a SMPL body. `unit` (metres per unit, or "cm") and `up` ("Y", "Z") are for
    files that are not as their formats say; `mesh`, `skeleton` and `part` as in `formats.gltf.read_body`.
    SMPL's and glTF's bodies are put on the floor. Raises `FileNotFoundError`, `OSError` for a damaged file,
    `ValueError` for what does not fit, by file.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if not path.is_file():
        raise not_a_file(path, f"name a rigged body ({', '.join(SUFFIXES)})")
    if suffix not in SUFFIXES:
        raise ValueError(f"{path} is no rigged body that is known; give one of {', '.join(SUFFIXES)}.")
    smpl = suffix == ".pkl" or (suffix == ".npz" and is_smpl(path))
    if betas is not None and not smpl:
        raise ValueError(f"{path} is no SMPL body and has no betas; leave them out.")
    if suffix in GLTF:
        body, notes = read_body(path, mesh=mesh, skeleton=skeleton, part=part)
    elif mesh is not None or skeleton is not None:
        what = "mesh" if skeleton is None else "skeleton"
        raise ValueError(f"{path} holds one body; leave out --{part}{'-' if part else ''}{what}.")
    else:
        body, notes = _smpl(path, betas) if smpl else (_rigged(path, suffix), ())
    body = _converted(body, unit, up)
    _check_extent(body, path, unit)
    if suffix in GLTF:
        _check_facing(body, path)
    return _on_the_floor(body, notes) if smpl or suffix in GLTF else LoadedBody(body, np.zeros(3), notes)


def place_template(template: np.ndarray, loaded: LoadedBody) -> np.ndarray:
    """Return a garment's template `[n, 3]`, metres, where the body now is.

    A garment that was made on the body in its file's own place is moved with it onto the floor; one that is
    nearer to the body as it stands stays. "Nearer" is the median distance to the body's vertices.
    """
    lift = loaded.origin.astype(template.dtype)
    if not lift.any():
        return template
    tree = KDTree(loaded.body.vertices)
    stays, moves = (float(np.median(tree.query(points)[0])) for points in (template, template + lift))
    return template + lift if moves < stays else template


def _smpl(path: Path, betas: np.ndarray | None) -> tuple[RiggedBody, tuple[str, ...]]:
    found = read_smpl(path, betas=betas)
    vertices, joints, weights = (
        x.astype(np.float32) for x in (found.vertices, found.joints, found.skin_weights)
    )
    return RiggedBody(vertices, found.faces, joints, found.parents, found.joint_names, weights), found.notes


def _rigged(path: Path, suffix: str) -> RiggedBody:
    if suffix == ".npz":
        return load_body(path)
    with open_sequence(path) as sequence:
        return sequence.scene.body


def _converted(body: RiggedBody, unit: float | str | None, up: str | None) -> RiggedBody:
    if unit is None and up is None:
        return body
    metres = metres_per_unit(unit or 1.0, "--body-unit")
    vertices, joints = (to_metres_y_up(x, metres, up or "Y") for x in (body.vertices, body.joints))
    return body._replace(vertices=vertices, joints=joints)


def _check_extent(body: RiggedBody, path: Path, unit: float | str | None) -> None:
    size = float(np.ptp(body.vertices, axis=0).max())
    if not SMALLEST <= size <= LARGEST:
        said = "its file's unit" if unit is None else f"unit {unit}"
        raise ValueError(
            f"{path}: the body is {size:.4g} m large in {said}; give --body-unit, for example cm, or "
            "convert it to metres."
        )


def _check_facing(body: RiggedBody, path: Path) -> None:
    """Raise `ValueError` for a body whose left is not at +X; names without sides tell nothing."""
    pairs = np.array(side_pairs(body.joint_names), np.int64).reshape(-1, 2)
    apart = body.joints[pairs[:, 0]] - body.joints[pairs[:, 1]]
    along, reach = float(apart[:, 0].sum()), _FACING * float(np.linalg.norm(apart, axis=1).sum())
    if len(pairs) and along < -reach:
        raise ValueError(
            f"{path}: the body faces -Z, its left joints are at -X; turn it by 180 degrees about Y in the "
            "program that it comes from."
        )
    if len(pairs) and along < reach:
        raise ValueError(
            f"{path}: the body does not stand Y up facing +Z, its left joints are not at +X; turn it in the "
            "program that it comes from, or give --body-up Z."
        )


def _on_the_floor(body: RiggedBody, notes: tuple[str, ...]) -> LoadedBody:
    lift = -float(body.vertices[:, 1].min())
    origin = np.array([0.0, lift, 0.0])
    up = origin.astype(np.float32)
    return LoadedBody(body._replace(vertices=body.vertices + up, joints=body.joints + up), origin, notes)
