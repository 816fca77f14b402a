"""Rigged bodies of every format: metres, Y up, on the floor."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.importers.bodies import place_template, read_any_body
from garment_jax.structs import RiggedBody
from garment_jax.validation.validate import validate_file
from tests.importers.glb_files import write_glb
from tests.reference.files import write_body
from tests.reference.scene import make_scene
from tests.reference.smpl import smpl_arrays, write_smpl

BODY = make_scene().body


def test_our_own_body_stays_as_it_is(tmp_path: Path):
    loaded = read_any_body(write_body(tmp_path / "me.npz", BODY))
    np.testing.assert_array_equal(loaded.body.vertices, BODY.vertices)
    assert loaded.origin.tolist() == [0, 0, 0]


def test_a_smpl_body_is_put_on_the_floor(tmp_path: Path):
    loaded = read_any_body(write_smpl(tmp_path / "model.npz"))
    assert abs(loaded.body.vertices[:, 1].min()) < 1e-6
    template = smpl_arrays()["v_template"]
    np.testing.assert_allclose(loaded.body.vertices - loaded.origin, template, atol=1e-6)
    assert loaded.body.joint_names[0] == "pelvis"
    assert loaded.notes[0].startswith("pose blend shapes (posedirs) are left out")
    assert read_any_body(tmp_path / "model.npz", betas=np.ones(2)).body.vertices.shape == template.shape


def test_a_garment_made_on_a_body_moves_with_it(tmp_path: Path):
    loaded = read_any_body(write_smpl(tmp_path / "model.npz"))
    there = smpl_arrays()["v_template"].astype(np.float32) * np.float32(1.01)
    moved = place_template(there, loaded)
    np.testing.assert_allclose(moved, there + loaded.origin, atol=1e-6)
    np.testing.assert_array_equal(place_template(moved, loaded), moved)


def test_another_unit_and_axis_are_converted(tmp_path: Path):
    def foreign(x: np.ndarray) -> np.ndarray:
        return np.stack([x[:, 0], -x[:, 2], x[:, 1]], axis=1) * np.float32(100)

    body = BODY._replace(vertices=foreign(BODY.vertices), joints=foreign(BODY.joints))
    path = write_body(tmp_path / "cm.npz", body)
    np.testing.assert_allclose(read_any_body(path, unit="cm", up="Z").body.vertices, BODY.vertices, atol=1e-6)
    with pytest.raises(
        ValueError, match=r"cm\.npz: the body is 1\d\d m large in its file's unit; give --body-unit"
    ):
        read_any_body(path)
    with pytest.raises(ValueError, match=r"--body-unit furlong is no unit; give one of m, dm, cm"):
        read_any_body(path, unit="furlong")
    with pytest.raises(ValueError, match=r"--up X is no up axis that is known; give Y or Z"):
        read_any_body(path, up="X")


def test_what_is_no_body_is_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"no\.npz is not there; name a rigged body"):
        read_any_body(tmp_path / "no.npz")
    (tmp_path / "me.dae").write_text("")
    with pytest.raises(ValueError, match=r"me\.dae is no rigged body that is known; give one of \.npz"):
        read_any_body(tmp_path / "me.dae")
    with pytest.raises(ValueError, match="is no SMPL body and has no betas; leave them out"):
        read_any_body(write_body(tmp_path / "me.npz", BODY), betas=np.ones(3))


NAMES = {
    "Mixamo": "mixamorig:{Left,Right}UpLeg",
    "Unreal": "thigh_{l,r}",
    "Blender": "thigh.{L,R}",
    "SMPL": "{left,right}_hip",
    "Biped": "Bip01 {L,R} Thigh",
    "at the end": "Leg{Left,Right}",
}


@pytest.mark.parametrize("style", NAMES)
@pytest.mark.parametrize("turned", [0, 90, 180])
def test_a_glb_that_faces_elsewhere_is_noticed_whatever_its_sides_are_called(
    tmp_path: Path, style: str, turned: int
):
    before, _, rest = NAMES[style].partition("{")
    sides, _, after = rest.partition("}")
    left, right = (before + side + after for side in sides.split(","))
    c, s = np.cos(np.radians(turned)), np.sin(np.radians(turned))
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]], np.float32)
    joints = np.array([[0, 1, 0], [0.1, 0.9, 0], [-0.1, 0.9, 0], [0, 1.6, 0]], np.float32)
    vertices = np.concatenate([joints + d for d in np.eye(3, dtype=np.float32) * 0.3])
    body = RiggedBody(
        vertices @ turn.T,
        np.arange(12, dtype=np.int32).reshape(3, 4).T,
        joints @ turn.T,
        np.array([-1, 0, 0, 0], np.int32),
        ("Hips", left, right, "Head"),
        np.tile(np.eye(4, dtype=np.float32), (3, 1)),
    )
    path = write_glb(tmp_path / "me.glb", body)
    if not turned:
        assert read_any_body(path).body.joint_names == body.joint_names
        return
    sentence = (
        "the body faces -Z, its left joints are at -X" if turned == 180 else "does not stand Y up facing"
    )
    with pytest.raises(ValueError, match=sentence):
        read_any_body(path)
    assert any(sentence in finding.value for finding in validate_file(path).findings)
