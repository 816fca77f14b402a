"""`garment-jax collide`: a finished sequence out of the body, with everything else kept."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.animation import collide
from garment_jax.animation.collide import Report, collide_file, summary
from garment_jax.body.kinematics import collider_points, joint_positions, pose_body
from garment_jax.body.limbs import limbs_of
from garment_jax.evaluation.penetration import (
    closed_surface,
    neighbour_faces,
    signed_distance,
)
from garment_jax.evaluation.piercing import pierced_bones
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.postprocess.collision import MESSAGES, Outcome
from garment_jax.postprocess.collision.solid import everything
from garment_jax.postprocess.figures import FrameFigures
from garment_jax.structs import Collider, Scene
from tests.reference.scene import make_motion, make_scene, make_vertices

SCENE = make_scene()
FRAMES = 18
MOTION = make_motion(SCENE, FRAMES, seed=3)
ADDED = {
    "collision_deepest_after_mm",
    "collision_deepest_before_mm",
    "collision_outcome",
    "collision_penetrating_after",
    "collision_penetrating_before",
    "collision_pierced_bones",
    "collision_pop_mm",
    "collision_self_crossings",
    "collision_steps",
}


def thin_vertices() -> np.ndarray:
    """The garment drawn in towards the body's axis; its pins stay."""
    V = make_vertices(SCENE, MOTION)
    axis = MOTION.root[:, None] * [1, 0, 1] + V * [0, 1, 0]
    thin = axis + 0.45 * (V - axis)
    thin[:, SCENE.pins.vertices] = V[:, SCENE.pins.vertices]
    return thin.astype(np.float32)


def write(path: Path, V: np.ndarray, *, scene: Scene = SCENE, motion=MOTION, **options) -> Path:
    attributes = {"name": "waltz", "kind": "predicted", "source": "a test"}
    with SequenceWriter(path, scene, motion, attributes=attributes, **options) as writer:
        writer.append(V)
        writer.add_per_frame("mood", np.arange(len(V)))
    return path


@pytest.fixture(scope="module")
def thin(tmp_path_factory) -> Path:
    return write(tmp_path_factory.mktemp("thin") / "thin.h5", thin_vertices(), encoding="float32")


@pytest.fixture(scope="module")
def done(thin) -> tuple[Path, Report]:
    out = thin.with_name("out.h5")
    return out, collide_file(thin, out)


def lowest(path: Path, collider: Collider) -> np.ndarray:
    """The smallest exact signed distance of a free vertex of each frame, metres."""
    with open_sequence(path) as clip:
        V = clip.read(0, clip.frames)
        body = pose_body(clip.scene.body, clip.motion, slice(None))
    free = np.setdiff1d(np.arange(V.shape[1]), SCENE.pins.vertices)
    neighbours, posed = neighbour_faces(collider.faces), collider_points(collider, body)
    return np.array(
        [
            signed_distance(v[free], closed_surface(c, collider.faces, neighbours)).min()
            for v, c in zip(V, posed, strict=True)
        ]
    )


def test_no_vertex_stays_inside_and_the_figures_say_what_was_done(thin, done):
    out, report = done
    assert lowest(thin, SCENE.collider).min() < -0.01
    assert lowest(out, SCENE.collider).min() > 0.003
    with open_sequence(out) as made:
        columns = {name: made.read_extra(name, 0, FRAMES) for name in ADDED}
    assert columns["collision_penetrating_after"].max() == 0
    np.testing.assert_allclose(columns["collision_pop_mm"], 1e3 * report.figures.pop)
    assert report.frames == FRAMES
    assert set(columns["collision_outcome"]) <= {Outcome.CONVERGED, Outcome.STEPS_SPENT}


def test_without_limbs_the_depth_before_is_that_of_the_sequence(thin, tmp_path):
    plain = collide_file(thin, tmp_path / "plain.h5", limbs=False)
    deepest = -lowest(thin, SCENE.collider)
    np.testing.assert_allclose(plain.figures.deepest_before, deepest, atol=1e-4)
    assert not plain.figures.pierced.any()
    assert lowest(tmp_path / "plain.h5", SCENE.collider).min() > 0.003


def test_limbs_that_run_through_the_cloth_are_counted_and_leave_it(thin, done):
    with open_sequence(done[0]) as made:
        pierced = made.read_extra("collision_pierced_bones", 0, FRAMES)
        after, motion = made.read(0, FRAMES), made.motion
    joints = limbs_of(SCENE.body, SCENE.collider).joints
    bones = joint_positions(motion.rotations, motion.root, SCENE.body)[:, joints]
    faces = SCENE.garment.faces
    np.testing.assert_array_equal(pierced, pierced_bones(thin_vertices(), bones, faces))
    assert pierced.any()
    begun = slice(1, None)  # the first frame is on its side by definition
    assert (pierced_bones(after, bones, faces)[begun] <= pierced[begun]).all()


def test_attributes_motion_extras_pins_and_what_is_far_from_the_body_are_kept(thin, done):
    with open_sequence(thin) as given, open_sequence(done[0]) as made:
        assert made.attributes == given.attributes | {"collision_eps_m": 0.004}
        np.testing.assert_array_equal(made.motion.root, given.motion.root)
        assert set(made.extra_names) == {"mood"} | ADDED
        np.testing.assert_array_equal(made.read_extra("mood", 0, FRAMES), np.arange(FRAMES))
        assert (made.encoding, made.scale) == (given.encoding, given.scale)
        V, out = given.read(0, FRAMES), made.read(0, FRAMES)
    np.testing.assert_array_equal(out[:, SCENE.pins.vertices], V[:, SCENE.pins.vertices])
    still = (out == V).all(axis=(0, 2))
    assert 0 < still.sum() < len(still)


def test_windows_change_nothing(thin, done, tmp_path, monkeypatch):
    monkeypatch.setattr(collide, "WINDOW", 1)
    report = collide_file(thin, tmp_path / "again.h5")
    np.testing.assert_array_equal(report.figures.outcome, done[1].figures.outcome)
    np.testing.assert_allclose(report.figures.pop, done[1].figures.pop, atol=1e-5)
    with open_sequence(tmp_path / "again.h5") as again, open_sequence(done[0]) as made:
        np.testing.assert_allclose(again.read(0, FRAMES), made.read(0, FRAMES), atol=1e-4)


def test_done_again_there_is_nothing_to_do(done, tmp_path):
    report = collide_file(done[0], tmp_path / "twice.h5")
    assert set(report.figures.outcome) == {Outcome.NOTHING_TO_DO}
    with open_sequence(tmp_path / "twice.h5") as twice, open_sequence(done[0]) as once:
        np.testing.assert_array_equal(twice.read(0, FRAMES), once.read(0, FRAMES))
        assert set(twice.extra_names) == {"mood"} | ADDED  # the old figures are replaced


def high_vertices() -> np.ndarray:
    """A garment with five vertices in the chest, above the collider's cap."""
    V = make_vertices(SCENE, MOTION)
    chest = MOTION.root + [0.0, 0.5, 0.0]
    V[:, -5:] = chest[:, None] + 0.01 * np.random.default_rng(0).normal(size=(FRAMES, 5, 3))
    return V


def test_the_whole_body_counts_when_asked(tmp_path):
    path, body = write(tmp_path / "high.h5", high_vertices()), everything(SCENE.body)
    assert lowest(path, body).min() < -0.01
    collide_file(path, tmp_path / "part.h5")
    assert lowest(tmp_path / "part.h5", body).min() < -0.01
    collide_file(path, tmp_path / "whole.h5", whole_body=True)
    assert lowest(tmp_path / "whole.h5", body).min() > -1e-4
    with open_sequence(tmp_path / "whole.h5") as made:
        assert made.encoding == "int16"
        np.testing.assert_array_equal(made.scene.collider.faces, SCENE.collider.faces)


def test_a_rigged_body_follows_the_sequences_motion_and_is_taken_whole(tmp_path):
    body = SCENE.body
    np.savez(tmp_path / "me.npz", **{name: np.array(x) for name, x in body._asdict().items()})
    bare = SCENE._replace(collider=None)  # with pins it is the program of the test before
    path = write(tmp_path / "high.h5", high_vertices(), scene=bare)
    collide_file(path, tmp_path / "out.h5", body=tmp_path / "me.npz")
    assert lowest(tmp_path / "out.h5", everything(body)).min() > -1e-4
    with open_sequence(tmp_path / "out.h5") as made:
        np.testing.assert_array_equal(made.scene.collider.faces, body.faces)


def test_the_body_of_another_sequence_takes_its_place(tmp_path, thin):
    shifted = MOTION._replace(root=MOTION.root + [0.02, 0.0, 0.0])
    other = write(tmp_path / "other.h5", make_vertices(SCENE, shifted), motion=shifted)
    collide_file(thin, tmp_path / "out.h5", body=other)
    assert lowest(tmp_path / "out.h5", SCENE.collider).min() > 0.003
    with open_sequence(tmp_path / "out.h5") as made:
        np.testing.assert_array_equal(made.motion.root, shifted.root)


def test_a_motion_of_one_frame_is_resolved(tmp_path):
    motion = make_motion(SCENE, 1)
    V = make_vertices(SCENE, motion)
    V[:, 40] = motion.root + [[0.0, -0.05, 0.0]]
    path = write(tmp_path / "one.h5", V, motion=motion)
    report = collide_file(path, tmp_path / "out.h5")
    assert report.figures.penetrating_before[0] > 0 == report.figures.penetrating_after[0]


def test_stopped_in_the_middle_nothing_is_left(tmp_path, thin, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(collide.FrameProgress, "__call__", stop)
    with pytest.raises(KeyboardInterrupt):
        collide_file(thin, tmp_path / "out.h5")
    assert list(tmp_path.iterdir()) == []


def without_collider(folder: Path) -> dict:
    return {"path": write(folder / "bare.h5", thin_vertices(), scene=SCENE._replace(collider=None))}


def opened_collider(folder: Path) -> dict:
    collider = SCENE.collider._replace(faces=SCENE.collider.faces[1:])
    return {"path": write(folder / "open.h5", thin_vertices(), scene=SCENE._replace(collider=collider))}


def without_vertices(folder: Path) -> dict:
    with SequenceWriter(folder / "motion.h5", SCENE, MOTION, encoding="none"):
        pass
    return {"path": folder / "motion.h5"}


def truncated(folder: Path) -> dict:
    path = write(folder / "cut.h5", thin_vertices())
    path.write_bytes(path.read_bytes()[:-4000])
    return {"path": path}


def not_finite(folder: Path) -> dict:
    import h5py

    path = write(folder / "nan.h5", thin_vertices(), encoding="float32")
    with h5py.File(path, "r+") as file:
        file["vertices"][5, 7, 1] = np.nan
    return {"path": path}


def shorter_body(folder: Path) -> dict:
    motion = make_motion(SCENE, 4)
    return {"body": write(folder / "short.h5", make_vertices(SCENE, motion), motion=motion)}


def other_skeleton(folder: Path) -> dict:
    names = tuple(name.replace("Left", "L_") for name in SCENE.body.joint_names)
    scene = SCENE._replace(body=SCENE.body._replace(joint_names=names))
    return {"body": write(folder / "named.h5", thin_vertices(), scene=scene)}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (without_collider, "bare.h5 has no collider; use --whole-body, or"),
        (opened_collider, "the collider of .*open.h5 has 3 open edges"),
        (without_vertices, "holds a motion without garment vertices"),
        (truncated, "cut.h5 is truncated"),
        (not_finite, "frame 5 is not finite; the rollout diverged"),
        (shorter_body, "has 4 frames at 30 fps and .* 18 at 30; give the body of the same frames"),
        (other_skeleton, "has other joints .* give a body with the same skeleton"),
        (lambda _: {"path": "nowhere.h5"}, "nowhere.h5 is not there"),
        (lambda _: {"body": "nowhere.npz"}, "nowhere.npz"),
        (lambda _: {"eps": -0.001}, "--eps -1 mm is out of range; give 0 to 100 millimetres, such as 4"),
        (lambda _: {"eps": 4.0}, "--eps 4000 mm is out of range"),
        (lambda _: {"eps": float("nan")}, "--eps nan mm is out of range"),
        (lambda _: {"iterations": -1}, "--iterations -1 is out of range; give the gradient steps"),
        (lambda _: {"iterations": 9_999_999_999}, "--iterations 9999999999 is out of range"),
    ],
)
def test_refusals_leave_nothing_behind(tmp_path, thin, change, sentence):
    words = {"path": thin, "out": tmp_path / "out" / "out.h5"} | change(tmp_path)
    with pytest.raises((ValueError, OSError), match=sentence):
        collide_file(**words)
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.parametrize("same", ["path", "body"])
def test_what_is_read_is_not_overwritten(tmp_path, thin, same):
    words = {"path": thin, "out": tmp_path / "." / "x.h5", same: tmp_path / "x.h5"}
    with pytest.raises(ValueError, match=r"x.h5 is what is read, .*; write to another file"):
        collide_file(**words)


def test_what_is_there_is_replaced_with_force_alone(tmp_path, thin, monkeypatch):
    simulated = tmp_path / "simulated.h5"
    with SequenceWriter(simulated, SCENE, MOTION) as writer:
        writer.append(make_vertices(SCENE, MOTION))
    before = simulated.read_bytes()
    with pytest.raises(ValueError, match=r"simulated\.h5 is there already; --force replaces it, or name"):
        collide_file(thin, simulated)
    assert simulated.read_bytes() == before
    collide_file(thin, simulated, force=True)
    with open_sequence(simulated) as made:
        assert made.attributes["collision_eps_m"] > 0


def test_the_summary_names_the_frames_with_a_limb_or_the_garment_through_the_cloth():
    zero = np.zeros(4)
    figures = FrameFigures(
        zero, zero, zero, zero, zero, zero, np.array([0, 2, 0, 1]), zero, np.array([0, 0, 9, 0])
    )
    _, limbs, tangled = summary(Report(4, 0.5, figures))
    assert limbs.startswith("2 frames (1, 3): a limb ran through the cloth")
    assert tangled == "1 frame (2): the garment still goes through itself."


def test_the_summary_names_what_fell_short_and_the_remedy():
    outcome = np.array([Outcome.NOTHING_TO_DO, *[Outcome.STEPS_SPENT] * 6, Outcome.STILL_INSIDE, 1])
    zero, pop = np.zeros(9), np.array([0, 0, 0, 0.0123, 0, 0, 0, 0, 0])
    figures = FrameFigures(zero + 0.02, zero, zero + 3, zero, zero, outcome, zero, pop, zero)
    first, spent, inside = summary(Report(9, 0.5, figures))
    assert "9 frames, 18 frames/s" in first
    assert "deepest 20.00 mm before, 0.00 after" in first
    assert "27 before, 0 after; 7 frames not converged; largest pop 12.30 mm (frame 3)" in first
    assert spent == f"6 frames (1, 2, 3, 4, 5, …): {MESSAGES[Outcome.STEPS_SPENT]}"
    assert inside == f"1 frame (7): {MESSAGES[Outcome.STILL_INSIDE]}"
