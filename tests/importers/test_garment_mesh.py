"""Garments of any kind: what is found, what is repaired, and that vertices stay as they are."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from garment_jax.importers.finding import worst
from garment_jax.importers.garment_mesh import load_garment, prepare_garment
from garment_jax.importers.mesh_checks import check_mesh
from garment_jax.importers.unwrap import unwrap_garment
from garment_jax.importers.uv_checks import charts, check_uvs, fit_uv, signed_areas
from garment_jax.structs import Garment
from tests.reference.files import write_obj
from tests.reference.scene import make_scene

SKIRT = make_scene().garment


def write(path: Path, garment: Garment, *, uv: bool = True) -> Path:
    if uv:
        return write_obj(path, garment)
    lines = [f"v {x} {y} {z}" for x, y, z in garment.template.tolist()]
    lines += ["f " + " ".join(map(str, face)) for face in (garment.faces + 1).tolist()]
    path.write_text("\n".join(lines))
    return path


def told(garment: Garment) -> dict[str, str]:
    findings = check_mesh(garment.template, garment.faces) + check_uvs(garment)
    return {f.check: f"{f.severity}: {f.value} {f.where}".strip() for f in findings if f.severity != "ok"}


def with_faces(*faces: tuple[int, int, int]) -> Garment:
    """The skirt with more faces, each with texture vertices 0, 1 and 17."""
    more = np.tile(np.array([[0, 17, 1]], np.int32), (len(faces), 1))
    return SKIRT._replace(
        faces=np.concatenate([SKIRT.faces, np.array(faces, np.int32)]),
        faces_uv=np.concatenate([SKIRT.faces_uv, more]),
    )


def moved(vertex: int, to: int) -> Garment:
    template = SKIRT.template.copy()
    template[vertex] = template[to]
    return SKIRT._replace(template=template)


def flipped(*faces: int) -> Garment:
    a, b = SKIRT.faces.copy(), SKIRT.faces_uv.copy()
    for face in faces:
        a[face], b[face] = a[face, ::-1], b[face, ::-1]
    return SKIRT._replace(faces=a, faces_uv=b)


def two_pieces() -> Garment:
    """Two skirts, one above the other; the second has the left half of the map, as the first has."""
    n, u = len(SKIRT.template), len(SKIRT.uv)
    half = SKIRT.uv * np.float32([0.5, 1])
    return Garment(
        np.concatenate([SKIRT.template, SKIRT.template + np.float32([0, 0.7, 0])]),
        np.concatenate([SKIRT.faces, SKIRT.faces + n]),
        np.concatenate([half, half + np.float32([0.5, 0])]),
        np.concatenate([SKIRT.faces_uv, SKIRT.faces_uv + u]),
    )


def split_seam() -> Garment:
    """The skirt as an exporter writes it that splits vertices at UV seams."""
    place = np.zeros(len(SKIRT.uv), np.int64)
    place[SKIRT.faces_uv] = SKIRT.faces
    return SKIRT._replace(template=SKIRT.template[place], faces=SKIRT.faces_uv)


def folded() -> Garment:
    """A vertex of the template pulled beyond the ring above it."""
    grid = SKIRT.template.reshape(8, 16, 3).copy()
    grid[4, 5] = grid[2, 5] + 0.3 * (grid[1, 5] - grid[2, 5])
    return SKIRT._replace(template=grid.reshape(-1, 3))


FAULTS: dict[str, tuple[Callable[[], Garment], dict[str, str]]] = {
    "unused vertex": (
        lambda: SKIRT._replace(template=np.concatenate([SKIRT.template, SKIRT.template[:1] + 0.01])),
        {"unused vertices": "error: 1 of 129 vertices belong to no face vertex 128"},
    ),
    "duplicate": (
        lambda: with_faces((16, 1, 0)),
        {"duplicate faces": "error: 1 of 225 faces repeat another one or a vertex of their own face 224"},
    ),
    "collapsed": (lambda: with_faces((3, 3, 4)), {"duplicate faces": "error: 1 of 225"}),
    "no area": (lambda: moved(40, 41), {"faces without area": "warning: 2 of 224 faces have no area faces"}),
    "wing": (lambda: with_faces((0, 16, 70)), {"non-manifold edges": "warning: 1 edges have more than two"}),
    "turned face": (
        lambda: flipped(50),
        {"winding": "warning: 3 edges have faces", "UV faces flipped": "warning: 1 of 224 faces"},
    ),
    "folded": (folded, {"folded faces": "warning"}),
    "split seam": (split_seam, {"split vertices": "warning: 16 boundary vertices lie on one another"}),
    "two pieces": (two_pieces, {"components": "note: 2 pieces"}),
    "no UVs": (
        lambda: SKIRT._replace(faces_uv=np.full_like(SKIRT.faces, -1)),
        {"UVs missing": "error: the garment has no UVs"},
    ),
    "some without UVs": (
        lambda: SKIRT._replace(faces_uv=np.where(np.arange(224)[:, None] < 3, -1, SKIRT.faces_uv)),
        {"UVs missing": "error: 3 of 224 faces have no UVs faces 0, 1, 2"},
    ),
    "UVs in metres": (
        lambda: SKIRT._replace(uv=3 * SKIRT.uv - 1),
        {"UV range": "error: `uv` runs from -1 to 2"},
    ),
    "UDIM": (
        lambda: SKIRT._replace(uv=SKIRT.uv * np.float32([3, 1]) + np.float32([0, 0])),
        {"UV range": "error: `uv` runs from 0 to 3, which looks like UDIM tiles"},
    ),
    "tiny UVs": (lambda: SKIRT._replace(uv=0.1 * SKIRT.uv), {"UV use": "warning: the charts cover 0.9"}),
    "UVs on a line": (
        lambda: SKIRT._replace(uv=SKIRT.uv * np.float32([1, 0])),
        {"UV faces without area": "error: 224 of 224", "UV use": "warning"},
    ),
    "folded UVs": (
        lambda: SKIRT._replace(uv=np.stack([np.abs(SKIRT.uv[:, 0] - 0.3), SKIRT.uv[:, 1]], 1)),
        {"UV faces flipped": "warning: 70 of", "UV overlap": "warning"},
    ),
}


def test_the_skirt_is_sound():
    assert told(SKIRT) == {}


@pytest.mark.parametrize("case", FAULTS)
def test_each_fault_is_named_with_its_count_and_its_place(case: str):
    make, expected = FAULTS[case]
    found = told(make())
    hidden = {"UV overlap", "winding", "non-manifold edges"} - set(expected)
    if case in ("duplicate", "collapsed", "wing"):  # what was added brings these with it
        found = {check: value for check, value in found.items() if check not in hidden}
    assert found.keys() == expected.keys(), found
    for check, words in expected.items():
        assert found[check].startswith(words), found[check]


def test_overlap_is_measured():
    """Two charts on the same half of the map: all of it is covered twice."""
    pieces = two_pieces()
    uv = np.concatenate([pieces.uv[:136], pieces.uv[:136] + np.float32([0.25, 0])])
    share = next(f for f in check_uvs(pieces._replace(uv=uv)) if f.check == "UV overlap")
    assert share.severity == "warning"
    assert 30 < float(share.value.split()[0]) < 36  # a third of what is covered


@pytest.mark.parametrize("garment", [SKIRT, two_pieces()], ids=["one", "two pieces"])
def test_unwrapping_leaves_vertices_and_faces_alone(tmp_path: Path, garment: Garment):
    pytest.importorskip("xatlas")
    path = write(tmp_path / "bare.obj", garment, uv=False)
    made, findings = load_garment(path, unwrap=True)
    np.testing.assert_array_equal(made.template, garment.template)
    np.testing.assert_array_equal(made.faces, garment.faces)
    assert 0 <= made.uv.min() <= made.uv.max() <= 1
    assert [f.check for f in findings if f.check == "UVs made"] == ["UVs made"]
    again, _ = load_garment(path, unwrap=True)
    np.testing.assert_array_equal(again.uv, made.uv)
    # texture vertices are the garment's own: each belongs to one vertex
    owner = np.full(len(made.uv), -1)
    owner[made.faces_uv] = made.faces
    np.testing.assert_array_equal(owner[made.faces_uv], made.faces)
    # and shapes are kept: areas in the map are those of the cloth, up to one scale
    a, b, c = made.template[made.faces].transpose(1, 0, 2)
    ratio = np.abs(signed_areas(made.uv, made.faces_uv)) / np.linalg.norm(np.cross(b - a, c - a), axis=1)
    assert ratio.max() / ratio.min() < 1.3


def test_a_garment_without_uvs_is_refused_with_the_remedy(tmp_path: Path):
    path = write(tmp_path / "bare.obj", SKIRT, uv=False)
    with pytest.raises(
        ValueError, match=r"bare\.obj: the garment has no UVs; unwrap it .* or give --unwrap\.$"
    ):
        load_garment(path)


def test_unwrapping_needs_its_library(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(__import__("sys").modules, "xatlas", None)
    with pytest.raises(ValueError, match=r"skirt cannot be unwrapped: xatlas is not installed; pip install"):
        unwrap_garment(SKIRT, "skirt")


def test_fitting_keeps_ratios_of_lengths(tmp_path: Path):
    wide = SKIRT._replace(uv=SKIRT.uv * np.float32([2.6, 0.6]) - np.float32([1, 0]))
    made, findings = load_garment(write(tmp_path / "wide.obj", wide), fit_uv=True)
    np.testing.assert_allclose(made.uv, (wide.uv - wide.uv.min(axis=0)) / 2.6, atol=1e-6)
    assert worst(findings) == "note"
    np.testing.assert_array_equal(
        fit_uv(np.ones((3, 2), np.float32)), np.zeros((3, 2))
    )  # a point stays finite


def test_duplicates_are_dropped_on_request(tmp_path: Path):
    path = write(tmp_path / "double.obj", with_faces((16, 1, 0), (3, 3, 4)))
    with pytest.raises(ValueError, match=r"2 of 226 faces repeat .* \(faces 224, 225\); .*--drop-duplicates"):
        load_garment(path)
    made, findings = load_garment(path, drop_duplicates=True)
    np.testing.assert_array_equal(made.faces, SKIRT.faces)
    np.testing.assert_array_equal(made.template, SKIRT.template)
    assert "2 of 226 faces" in {f.value for f in findings}


def test_an_unused_vertex_is_refused(tmp_path: Path):
    lone = SKIRT._replace(template=np.concatenate([SKIRT.template, SKIRT.template[:1]]))
    with pytest.raises(
        ValueError, match=r"1 of 129 vertices belong to no face \(vertex 128\); no cloth holds"
    ):
        load_garment(write(tmp_path / "lone.obj", lone))


def test_polygons_and_lines_of_other_programs_are_read(tmp_path: Path):
    quads = SKIRT.faces.reshape(-1, 6)[:, [0, 1, 5, 2]] + 1
    lines = [f"v {x} {y} {z} 1 1 1" for x, y, z in SKIRT.template.tolist()]
    lines += ["ny 0 1 0", "nv 3", "vn 0 1 0", "s off", "usemtl cloth"]
    lines += ["f " + " ".join(f"{v}//1" for v in quad) for quad in quads.tolist()]
    path = tmp_path / "quads.obj"
    path.write_text("\n".join(lines))
    garment, findings = prepare_garment(path)
    assert len(garment.faces) == 224
    assert [f.check for f in findings if f.severity != "ok"] == ["UVs missing"]
    np.testing.assert_array_equal(garment.template, SKIRT.template)


def test_charts_are_counted():
    assert len(np.unique(charts(SKIRT.faces_uv, len(SKIRT.uv)))) == 1
    assert len(np.unique(charts(two_pieces().faces_uv, 2 * len(SKIRT.uv)))) == 2


def test_simulate_refuses_a_garment_without_uvs(tmp_path: Path, capsys):
    from garment_jax.cli import main

    path = write(tmp_path / "bare.obj", SKIRT, uv=False)
    for name in ("b.npz", "m.bvh"):
        (tmp_path / name).write_text("not read")
    given = ["--body", str(tmp_path / "b.npz"), "--motion", str(tmp_path / "m.bvh")]
    own = ["--garment", str(path), *given, "--out", str(tmp_path / "o")]
    assert main(["simulate", "files", *own]) == 2
    assert "bare.obj: the garment has no UVs" in capsys.readouterr().err
