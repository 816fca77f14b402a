"""A garment that a user brings: any OBJ of triangles or polygons, checked; its vertices are never touched."""

from pathlib import Path

from garment_jax.importers.finding import Finding
from garment_jax.importers.mesh_checks import check_mesh, duplicate_faces
from garment_jax.importers.unwrap import unwrap_garment
from garment_jax.importers.uv_checks import charts, check_uvs
from garment_jax.importers.uv_checks import fit_uv as fitted
from garment_jax.io.obj import read_garment
from garment_jax.structs import Garment


def load_garment(
    path: str | Path, *, unwrap: bool = False, fit_uv: bool = False, drop_duplicates: bool = False
) -> tuple[Garment, list[Finding]]:
    """Return the garment of an OBJ file, lengths as they stand in it, and what is worth knowing about it.

    `unwrap` makes new UVs with xatlas, `fit_uv` brings UVs in metres or on UDIM tiles into 0 … 1,
    `drop_duplicates` leaves out faces that repeat another or one of their own vertices. Vertices are never
    reordered or removed. Findings have no errors: what cannot be used is refused by `ValueError` with the
    remedy, as are the reader's refusals (`read_garment`).
    """
    garment, findings = prepare_garment(path, unwrap=unwrap, fit_uv=fit_uv, drop_duplicates=drop_duplicates)
    for finding in findings:
        if finding.severity == "error":
            raise ValueError(finding.sentence(str(path)))
    return garment, findings


def prepare_garment(
    path: str | Path, *, unwrap: bool = False, fit_uv: bool = False, drop_duplicates: bool = False
) -> tuple[Garment, list[Finding]]:
    """Return as `load_garment`, but with errors among the findings instead of a refusal."""
    garment = read_garment(path, uv_required=False)
    done: list[Finding] = []
    if drop_duplicates:
        keep = ~duplicate_faces(garment.faces)
        if not keep.all():
            done.append(Finding("faces left out", "note", f"{int((~keep).sum())} of {len(keep)} faces"))
            garment = garment._replace(faces=garment.faces[keep], faces_uv=garment.faces_uv[keep])
    findings = check_mesh(garment.template, garment.faces)
    if unwrap and not any(finding.severity == "error" for finding in findings):
        garment = unwrap_garment(garment, str(path))
        count = int(charts(garment.faces_uv, len(garment.uv)).max()) + 1
        done.append(Finding("UVs made", "note", f"{count} charts, {len(garment.uv)} texture vertices"))
    elif fit_uv and len(garment.uv):
        garment = garment._replace(uv=fitted(garment.uv))
        done.append(Finding("UVs fitted", "note", "moved and scaled into 0 … 1, one scale"))
    return garment, [*findings, *check_uvs(garment), *done]
