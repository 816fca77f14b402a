"""Clips at the border: a test for every refusal of values."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.io.sequence import open_sequence
from garment_jax.io.validation import (
    FARTHEST_ROOT,
    check_clip,
    check_input,
    check_motion,
    check_poses,
    check_same_garment,
    to_motion,
)
from garment_jax.structs import Motion, Scene
from tests.reference.scene import make_motion, make_scene, make_vertices, write_clip

CENTIMETRES = 100.0


@pytest.fixture
def scene() -> Scene:
    return make_scene()


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene in another unit."""
    body = scene.body._replace(vertices=scene.body.vertices * factor, joints=scene.body.joints * factor)
    return scene._replace(garment=scene.garment._replace(template=scene.garment.template * factor), body=body)


def refuse(path: Path, sentence: str, **options) -> None:
    with open_sequence(path) as sequence, pytest.raises(ValueError, match=sentence) as refusal:
        check_clip(sequence, **options)
    assert "\n" not in str(refusal.value)


def test_a_sound_clip_passes_and_is_measured(tmp_path, scene):
    path = write_clip(tmp_path / "clip.h5", 12, scene=scene)
    motion = make_motion(scene, 12)
    V = make_vertices(scene, motion)
    with open_sequence(path) as sequence:
        extent = check_clip(sequence, joints=("Hips", "LeftFoot"), window=5)
    np.testing.assert_allclose(extent.low, V.min(axis=(0, 1)), atol=1e-4)
    np.testing.assert_allclose(extent.high, V.max(axis=(0, 1)), atol=1e-4)
    relative = V - motion.root[:, None]
    assert extent.reach == pytest.approx(np.abs(relative).max(), abs=1e-4)
    paths = [np.ptp(points, axis=0).max() for points in (V, relative)]
    assert extent.movement == pytest.approx(min(paths), abs=2e-4)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_vertices_that_are_not_finite_are_named_by_clip_and_frame(tmp_path, value):
    path = write_clip(tmp_path / "tango.h5", 12, encoding="float32")
    with h5py.File(path, "r+") as file:
        file["vertices"][8, 17, 2] = value
    refuse(path, rf"tango\.h5: vertex 17 of frame 8 is .*{value}.*; cut", window=5)


def test_wrong_units_are_refused_with_the_size(tmp_path, scene):
    """A 160-metre human: a body in centimetres whose file says metres."""
    large = scaled(scene, CENTIMETRES)
    body_only = scene._replace(body=large.body)
    garment_only = scene._replace(garment=large.garment)
    still = make_vertices(scene, make_motion(scene, 4))
    for name, broken, sentence in (
        ("a", body_only, r"a\.h5: the body is 13\d m large, which looks like centimetres"),
        ("b", garment_only, r"b\.h5: the template is 80 m large, which looks like centimetres"),
        ("c", scaled(scene, 1e-2), r"c\.h5: the template is 0\.008 m large, which looks like another unit"),
    ):
        path = write_clip(tmp_path / f"{name}.h5", 4, scene=broken, encoding="float32")
        refuse(path, sentence)
    path = write_clip(tmp_path / "d.h5", 4, encoding="float32")
    with h5py.File(path, "r+") as file:
        file["vertices"][...] = still * CENTIMETRES
    refuse(path, r"d\.h5: the garment reaches [\d.]+ m from the root, which looks like another unit")


def test_root_in_centimetres_or_a_jump_is_refused_with_its_frame(tmp_path, scene):
    motion = make_motion(scene, 12)
    refuse(
        write_clip(
            tmp_path / "a.h5", motion=motion._replace(root=motion.root * CENTIMETRES), encoding="float32"
        ),
        r"the root moves at [\d.]+ m/s in frame \d+; check for centimetres",
    )
    jump = motion.root + np.where(np.arange(12)[:, None] >= 7, 2.0, 0.0)
    refuse(write_clip(tmp_path / "b.h5", motion=motion._replace(root=jump)), r"m/s in frame 7; check")


def test_static_clips_are_refused(tmp_path, scene):
    motion = make_motion(scene, 12)
    still = Motion(motion.rotations[[0] * 12], motion.root[[0] * 12], 30.0)
    refuse(write_clip(tmp_path / "pose.h5", motion=still), r"pose\.h5 is static: its 12 frames hold one pose")
    path = write_clip(tmp_path / "world.h5", 12, encoding="float32")
    with h5py.File(path, "r+") as file:
        file["vertices"][...] = file["vertices"][:1]
    refuse(path, r"world\.h5 is static: no vertex moves more than 0\.000 mm; leave it out")
    path = write_clip(tmp_path / "carried.h5", 12)
    with h5py.File(path, "r+") as file:
        file["vertices"][...] = file["vertices"][:1]
    refuse(path, r"carried\.h5 is static: no vertex moves")


def test_broken_rotations_are_refused_with_their_frame(tmp_path, scene):
    motion = make_motion(scene, 12)
    rotations = motion.rotations.copy()
    rotations[5, 3] = 0
    path = write_clip(tmp_path / "clip.h5", motion=motion)
    with h5py.File(path, "r+") as file:
        file["rotations"][...] = rotations
    refuse(path, "rotations of frame 5 are no rotation matrices")
    with h5py.File(path, "r+") as file:
        file["rotations"][...] = motion.rotations * np.array([1, 1, -1], np.float32)
    refuse(path, "are no rotation matrices")


def test_a_mirrored_rotation_is_named_by_its_frame_and_joint(tmp_path, scene):
    motion = make_motion(scene, 12)
    rotations = motion.rotations.copy()
    rotations[9, 3] = rotations[9, 3] @ np.diag([1, 1, -1]).astype(np.float32)
    path, name = tmp_path / "clip.h5", scene.body.joint_names[3]
    write_clip(path, motion=motion)
    with h5py.File(path, "r+") as file:
        file["rotations"][...] = rotations
    refuse(path, rf"rotations of frame 9 are no rotation matrices \({name}\); export them again")
    rotations[4, 1] = np.nan
    with pytest.raises(ValueError, match=r"rotations of frame 4 are no rotation matrices \(joint 1\)"):
        check_motion(motion._replace(rotations=rotations), "a motion")


def test_arrays_that_are_no_motion_are_refused(scene):
    motion, names = make_motion(scene, 12), scene.body.joint_names
    R, root, fps = motion
    for bad, sentence in (
        ((R[:5], root[:4]), "a motion has 5 rotations and 4 roots"),
        ((R[:0], root[:0]), "a motion has no frames"),
        ((R[:, :-1], root), r"21 joints and the body 22; give the rotations of Hips, .*RightToeBase"),
        ((R[..., 0], root), r"rotations \[12, 22, 3\] and root \[12, 3\]; give rotation matrices"),
        ((R[0], root[0]), r"root \[3\]; give .* \[t, j, 3, 3\] and \[t, 3\]"),
        ((R, root[:, 0]), r"root \[12\]; give"),
        ((R, root, np.nan), "a motion has nan fps; give frames a second"),
        ((R, root, np.inf), "inf fps"),
        ((R, root, -30), "-30.0 fps"),
        ((R, root, "30"), "fps is '30', no real numbers; give one, such as 30"),
        ((R, root, root), r"fps has the shape \[12, 3\]"),
        ((R.astype(complex), root), "rotations is of type complex128, no real numbers; give an array of flo"),
        ((R.astype(object), root), "rotations is of type object"),
        ((R, [[1.0], [2.0, 3.0]]), r"root is \[\[1.0\], \[2.0, 3.0\]\], no real numbers"),
        ((R, root + 1e6), r"root of frame 0 is at \[.*; move it to within 16384 m of the origin"),
        ((R, root + 1e30), "move it to within 16384 m"),
        ((R.astype(np.float64) * 1e200, root), "no rotation matrices"),
    ):
        with pytest.raises(ValueError, match=sentence):
            check_motion(to_motion(bad, "a motion", fps=fps), "a motion", joints=names)


def test_arrays_and_lists_of_numbers_are_a_motion(scene):
    motion = make_motion(scene, 3)
    R, root, fps = motion
    far = motion._replace(root=root.astype(np.float64) + [10_000.0, 0.0, 0.0])
    check_poses(far, "10 km away", joints=scene.body.joint_names)
    check_poses(motion._replace(root=0 * root - FARTHEST_ROOT), "at the border")
    for given in ((R, root), [R.tolist(), root.tolist()], (R, root, np.array(fps)), (R, root, int(fps))):
        made = to_motion(given, "a motion", fps=fps)
        check_motion(made, "a motion")
        np.testing.assert_array_equal(made.rotations, R)
        np.testing.assert_array_equal(made.root, root)
        assert made.fps == fps


def test_missing_joints_are_named(tmp_path, scene):
    path = write_clip(tmp_path / "clip.h5", 4)
    refuse(
        path, r"clip\.h5: the body has no joint Tail, LeftWing; it has Hips.*", joints=("Tail", "LeftWing")
    )
    with open_sequence(path) as sequence, pytest.raises(ValueError, match="has no joint Tail"):
        check_input(sequence, joints=("Hips", "Tail"))
    with open_sequence(path) as sequence:
        check_input(sequence, joints=("all",))


def test_input_is_checked_without_its_vertices(tmp_path):
    """A motion to animate needs no truth: what its vertices are is not read."""
    path = write_clip(tmp_path / "clip.h5", 12, encoding="float32")
    with h5py.File(path, "r+") as file:
        file["vertices"][...] = np.nan
    with open_sequence(path) as sequence:
        check_input(sequence, joints=("Hips",))


def test_same_garment_passes_after_saving(tmp_path, scene):
    with open_sequence(write_clip(tmp_path / "clip.h5", 3, scene=scene)) as sequence:
        check_same_garment(scene.garment, sequence.scene.garment)


def test_other_garments_are_refused_by_what_differs(scene):
    garment = scene.garment
    moved = garment.template.copy()
    moved[3, 1] += 0.02
    cases = {
        r"the model has 128 garment vertices, the clip 144": make_scene(rings=9).garment,
        r"`faces` differs: the model has 224 rows, the clip 223": garment._replace(faces=garment.faces[1:]),
        r"`faces` differs between model and clip in 224 rows, first in row 0": garment._replace(
            faces=np.roll(garment.faces, 1, axis=1)
        ),
        r"`uv` differs between model and clip in \d+ rows": garment._replace(uv=garment.uv**2),
        r"`faces_uv` differs between": garment._replace(faces_uv=np.roll(garment.faces_uv, 1, axis=0)),
        r"templates of model and clip differ by up to 2 cm; use": garment._replace(template=moved),
    }
    for sentence, other in cases.items():
        with pytest.raises(ValueError, match=sentence):
            check_same_garment(garment, other)


def test_a_prediction_is_nothing_to_learn_from(tmp_path):
    path = write_clip(tmp_path / "guess.h5", 12, attributes={"kind": "predicted"})
    refuse(path, r"guess\.h5 is predicted, not simulated; give the clip that it was predicted for")
