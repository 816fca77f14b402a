"""Bodies read as a rest mesh and a cache of vertices."""

import struct

import numpy as np
import pytest

from garment_jax.body.kinematics import pose_body
from garment_jax.importers.vertex_body import read_vertex_body
from tests.body.three_tubes import figure, motion

BODY = figure()
V = pose_body(BODY, motion(20, seed=0), slice(None))


def write(folder, points, frames):
    """Write the rest mesh as OBJ and its frames as PC2, by hand."""
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in points]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in BODY.faces]
    (folder / "rest.obj").write_text("\n".join(lines) + "\n")
    header = struct.pack("<12siiffi", b"POINTCACHE2\0", 1, frames.shape[1], 0.0, 1.0, len(frames))
    (folder / "body.pc2").write_bytes(header + frames.astype("<f4").tobytes())
    return folder / "rest.obj", folder / "body.pc2"


def test_a_rest_mesh_and_a_cache_become_a_body_and_a_motion(tmp_path):
    fitted, notes = read_vertex_body(*write(tmp_path, BODY.vertices, V), fps=25, joints=3)
    assert fitted.motion.fps == 25
    again = pose_body(fitted.body, fitted.motion, slice(None))
    assert np.linalg.norm(again - V, axis=2).mean() < 1e-3
    assert len(notes) == 3
    assert "3 joints follow the body to 0.0" in notes[0]
    assert "taken for metres" in notes[1]
    assert "does not say its up axis: Y is taken" in notes[2]


def test_centimetres_with_z_up_are_converted_and_a_known_rig_is_kept(tmp_path):
    def foreign(points):
        return 100 * np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)

    files = write(tmp_path, foreign(BODY.vertices), foreign(V))
    fitted, notes = read_vertex_body(*files, fps=30, unit="cm", up="Z", rig=BODY)
    assert fitted.body is BODY
    assert fitted.residual_cm.largest < 0.01
    assert len(notes) == 1
    fitted, notes = read_vertex_body(*write(tmp_path, foreign(BODY.vertices) / 100, V), fps=30, joints=3)
    assert "degrees in the mean; check the up axis" in notes[-1]


def test_rest_mesh_and_cache_are_two_files_of_their_own_unit_and_axis(tmp_path):
    """Metres, Y up, as OBJ exporters write, beside a stage in centimetres with Z up."""
    turned = 100 * np.stack([V[..., 0], -V[..., 2], V[..., 1]], axis=-1)
    files = write(tmp_path, BODY.vertices, turned)
    for said in ({}, {"rest_unit": "m", "rest_up": "Y"}):
        fitted, notes = read_vertex_body(*files, fps=30, unit="cm", up="Z", joints=3, **said)
        np.testing.assert_allclose(fitted.body.vertices, BODY.vertices, atol=1e-6)
        assert np.linalg.norm(pose_body(fitted.body, fitted.motion, slice(None)) - V, axis=2).mean() < 1e-3
        assert any("stands along Y and" in note for note in notes) == (not said)
    again, _ = read_vertex_body(*files, fps=30, unit="cm", up="Z", rig=fitted.body)
    np.testing.assert_allclose(again.motion.root, fitted.motion.root, atol=1e-5)


def test_refusals(tmp_path):
    rest, cache = write(tmp_path, BODY.vertices, V)
    with pytest.raises(ValueError, match=r"body\.pc2 has no frame rate"):
        read_vertex_body(rest, cache)
    with pytest.raises(
        ValueError, match=r"1 joints follow the body to .* more than 1 cm in the mean; ask for"
    ):
        read_vertex_body(rest, cache, fps=30, joints=1)
    assert read_vertex_body(rest, cache, fps=30, joints=1, most_residual=None).fitted.residual_cm.mean > 1
    write(tmp_path, BODY.vertices * 1.3, V)
    with pytest.raises(ValueError, match=r"pc2 are 0\.769 times as long as those of .*--motion-unit"):
        read_vertex_body(rest, cache, fps=30, unit="m")
    write(tmp_path, BODY.vertices * 100, V * 100)
    with pytest.raises(
        ValueError, match=r"is 1\d\d units large, and its file does not say which; give --body-unit"
    ):
        read_vertex_body(rest, cache, fps=30)
    write(tmp_path, BODY.vertices, V[:, :-1])
    with pytest.raises(ValueError, match=r"287 vertices and .* 288; export both from one mesh"):
        read_vertex_body(rest, cache, fps=30)
    broken = V.copy()
    broken[0, 0, 0] = np.nan
    write(tmp_path, BODY.vertices, broken)
    with pytest.raises(ValueError, match="frame 0 holds values that are not finite"):
        read_vertex_body(rest, cache, fps=30)
