"""A whole motion through a whole model: pins, preroll, place in the world, files, refusals."""

import gc
import sys
import tracemalloc
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from garment_jax import progress
from garment_jax.animation import network_method
from garment_jax.animation.animate import Early, animate, animate_file, make_animator, training_range
from garment_jax.aot_cache import ProgramStore
from garment_jax.body import frame_windows
from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.body.motion_features import feature_names
from garment_jax.body.preroll import with_preroll
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.config import RolloutConfig
from garment_jax.io import sequence_writer
from garment_jax.io.content_hash import garment_hash
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.model.scan import make_rollout
from garment_jax.model.store import Model
from garment_jax.postprocess.pipeline import BodyFrame, shape_init, shape_step
from garment_jax.postprocess.tables import make_shape_tables
from garment_jax.structs import Motion, Scene
from tests.animation.tiny_model import CONFIG, SCENE, alone, first_state, inputs_of, template, tiny_model
from tests.reference.scene import make_motion, make_scene, write_clip


def frames_of(model: Model, motion: Motion, *, scene: Scene = SCENE, collision: bool = False, **options):
    """Return the whole animation, `[t, n, 3]` world metres."""
    chunks = animate(model, scene, motion, collision=collision, **options)
    return np.concatenate([chunk.V for chunk in chunks])


def test_pins_are_the_bodys_and_the_rest_is_the_rollout_in_the_world():
    motion = make_motion(SCENE, 20)
    V = frames_of(tiny_model(), motion)
    pins = SCENE.pins
    assert pins is not None
    positions = joint_positions(motion.rotations, motion.root, SCENE.body)
    points = SCENE.garment.template[pins.vertices]
    expected = pose_points(points, pins.weights, motion.rotations, positions, SCENE.body.joints)
    np.testing.assert_allclose(V[:, pins.vertices], expected, atol=1e-6)
    inputs = inputs_of(motion)
    run = make_rollout(template(), CONFIG)
    rolled = run(tiny_model().params, alone(first_state(inputs)), inputs.x)[1]
    back, rolled = to_root(V.astype(np.float64), inputs.root, inputs.yaw), np.asarray(rolled, np.float64)
    tables, state = make_shape_tables(SCENE.garment, template().laplacian, pins.vertices), None
    one = jax.jit(partial(shape_step, tables=tables))
    for V_f, expected in zip(rolled, back, strict=True):
        body = BodyFrame(jnp.asarray(expected[pins.vertices]), jnp.zeros((0, 3)), jnp.zeros((0, 2, 3)))
        state = shape_init(jnp.asarray(V_f), body, tables=tables) if state is None else state
        state, made, _ = one(state, jnp.asarray(V_f, jnp.float32), body)
        np.testing.assert_allclose(expected, made, atol=1e-5)


def test_the_first_frames_are_there_before_contact_handling_is_compiled(tmp_path: Path):
    motion, model = make_motion(SCENE, 20), tiny_model()
    run = make_animator(model, SCENE, store=ProgramStore(tmp_path), early=True)
    chunks = run.early(motion, 18)
    assert chunks is not None
    first = [chunk.V for chunk in chunks]
    assert [len(V) for V in first] == [16, 2]
    np.testing.assert_array_equal(np.concatenate(first), frames_of(model, motion)[:18])
    assert run.give_up()  # nobody asked for the others
    assert [path.name for path in tmp_path.glob("contacts*")] == []
    free = make_animator(model, SCENE, collision=False, store=ProgramStore(tmp_path), early=True)
    assert free.early(motion, 18) is None


def test_a_refused_motion_does_not_keep_the_next_from_an_animator(tmp_path: Path):
    good = write_clip(tmp_path / "good.h5", frames=4, scene=SCENE)
    bad = write_clip(tmp_path / "bad.h5", scene=SCENE, motion=make_motion(SCENE, 4)._replace(fps=47.0))
    early = Early(tmp_path / "early.h5", lambda: None)
    known: dict = {}
    with pytest.raises(ValueError, match="fps"):
        animate_file(tiny_model(), bad, tmp_path / "made.h5", animators=known, early=early)
    assert not known
    assert not (tmp_path / "made.h5").exists()
    animate_file(tiny_model(), good, tmp_path / "made.h5", collision=False, animators=known, early=early)
    assert len(known) == 1


@pytest.mark.parametrize(
    ("ranges", "feature", "said"),
    [
        (0.256, "Spine rotation 4", "Spine turns farther than in any training motion"),
        (0.256, "root tilt 0", "the root tilts farther than in any training motion"),
        (0.256, "root yaw rate rad/s", "the root turns faster than in any training motion"),
        (0.256, "root velocity x m/s", "the root moves faster than in any training motion"),
        (0.256, "Left Arm position z m", "Left Arm reaches farther than in any training motion"),
        (122.15, "Spine rotation 4", "Spine turns, which it hardly did in training"),
    ],
)
def test_what_a_motion_is_told_that_leaves_the_training_range(ranges: float, feature: str, said: str):
    module = sys.modules["garment_jax.animation.animate"]
    end = "; it is clamped there, so the cloth may lag or stretch."
    assert module._beyond_range(ranges, feature, 194, 30.0) == f"frame 194 (6.5 s): {said}{end}"


def test_every_feature_of_a_motion_has_words():
    module = sys.modules["garment_jax.animation.animate"]
    for name in feature_names(("Spine",)):
        said = module._beyond_range(0.5, name, 0, 30.0)
        assert said.startswith(("frame 0 (0.0 s): the root ", "frame 0 (0.0 s): Spine ")), said


def test_moving_100_m_and_turning_137_degrees_changes_less_than_a_tenth_of_a_millimetre():
    here = make_motion(SCENE, 100, seed=2)
    turn = yaw_matrix(np.array(np.radians(137.0)))
    there = Motion(turn @ here.rotations, here.root @ turn.T + [60.0, 0.0, -80.0], here.fps)
    shapes = []
    for motion in (here, there):
        V = frames_of(tiny_model(), motion).astype(np.float64)
        shapes.append(to_root(V, motion.root.astype(np.float64), heading(motion.rotations[:, 0])))
    assert np.linalg.norm(shapes[1] - shapes[0], axis=-1).max() < 1e-4


def test_the_length_of_a_chunk_changes_nothing():
    motion, model = make_motion(SCENE, 37), tiny_model()
    other = model._replace(config=CONFIG.__class__(**{**vars(CONFIG), "rollout": RolloutConfig(chunk=37)}))
    sizes = [len(chunk.V) for chunk in animate(model, SCENE, motion, collision=False)]
    assert sizes == [16, 16, 5]
    np.testing.assert_allclose(frames_of(other, motion), frames_of(model, motion), atol=1e-5)


def test_a_motion_without_vertices_is_animated_and_so_is_a_frozen_pose(tmp_path: Path):
    moving = make_motion(SCENE, 20)
    frozen = Motion(moving.rotations[[0] * 20], moving.root[[0] * 20], moving.fps)
    with SequenceWriter(tmp_path / "pose.h5", SCENE, frozen, encoding="none"):
        pass
    animate_file(tiny_model(), tmp_path / "pose.h5", tmp_path / "out.h5", collision=False)
    with open_sequence(tmp_path / "out.h5") as sequence:
        assert (sequence.encoding, sequence.attributes["kind"]) == ("int16", "predicted")
        np.testing.assert_allclose(sequence.read(0, 20), frames_of(tiny_model(), frozen), atol=5e-5)


def test_a_garment_that_may_swing_out_of_int16s_reach_is_stored_as_float32(tmp_path: Path):
    garment = SCENE.garment
    down = np.where(garment.template[:, 1:2] < garment.template[:, 1].mean(), 1.2, 0.0) * [[0.0, 1.0, 0.0]]
    long = SCENE._replace(garment=garment._replace(template=(garment.template - down).astype(np.float32)))
    motion, model = make_motion(long, 5), tiny_model()._replace(garment_hash=garment_hash(long.garment))
    for name, encoding in (("float32", "float32"), ("none", "float32")):
        with SequenceWriter(tmp_path / f"{name}.h5", long, motion, encoding=name) as writer:
            if name != "none":
                writer.append(np.repeat(long.garment.template[None], 5, axis=0))
        animate_file(model, tmp_path / f"{name}.h5", tmp_path / "out.h5", collision=False)
        with open_sequence(tmp_path / "out.h5") as sequence:
            assert sequence.encoding == encoding
            assert np.isfinite(sequence.read(0, 5)).all()


@pytest.mark.parametrize("preroll", [1, 16, 21])
def test_a_preroll_comes_before_the_clip_and_is_not_shown(preroll: int):
    motion, model = make_motion(SCENE, 20), tiny_model()
    V = frames_of(model, motion, preroll=preroll)
    whole = frames_of(model, with_preroll(motion, preroll))
    assert V.shape == (20, len(SCENE.garment.template), 3)
    # the longer motion's own first velocities are those of the preroll, so both are the same rollout
    np.testing.assert_array_equal(V, whole[preroll:])


def test_a_scene_without_collider_or_pins_is_animated():
    bare = SCENE._replace(collider=None, pins=None)
    motion = make_motion(SCENE, 6)
    V = frames_of(tiny_model(), motion, scene=bare, collision=True)
    assert V.shape == (6, len(SCENE.garment.template), 3)
    assert np.isfinite(V).all()


def test_collisions_are_resolved_and_pins_stay():
    motion = make_motion(SCENE, 18)
    chunks = list(animate(tiny_model(), SCENE, motion, collision=True))
    resolved = np.concatenate([chunk.V for chunk in chunks])
    deepest = np.concatenate([chunk.deepest for chunk in chunks])
    assert deepest.shape == (18,)
    assert deepest.max() > 0.001  # an untrained garment runs through the body
    figures = [chunk.collision for chunk in chunks]
    assert [len(figure.outcome) for figure in figures] == [16, 2]
    np.testing.assert_array_equal(np.concatenate([f.deepest_before for f in figures]), deepest)
    assert all((f.deepest_after <= f.deepest_before).all() for f in figures)
    bare = frames_of(tiny_model(), motion)
    pins = SCENE.pins
    assert pins is not None
    np.testing.assert_allclose(resolved[:, pins.vertices], bare[:, pins.vertices], atol=1e-6)
    assert np.abs(resolved - bare).max() > 0.001


def test_a_file_is_written_with_what_it_is_and_how_far_it_leaves_the_training_range(
    tmp_path: Path, capsys, monkeypatch
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(progress, "_TERMINAL_SECONDS", 0.0)
    clip = write_clip(tmp_path / "waltz.h5", 20, attributes={"name": "waltz"})
    figures = animate_file(tiny_model(), clip, tmp_path / "out" / "waltz.h5", collision=False)
    assert figures["frames"] == 20
    shown = capsys.readouterr().err
    assert "waltz: compiling" in shown
    assert "waltz: 20/20 frames" in shown
    with open_sequence(tmp_path / "out" / "waltz.h5") as made, open_sequence(clip) as given:
        assert made.attributes["kind"] == "predicted"
        assert made.name == "waltz"
        np.testing.assert_array_equal(made.motion.root, given.motion.root)
        outside = made.read_extra("outside_training_range", 0, 20)
        np.testing.assert_allclose(made.read(0, 20), frames_of(tiny_model(), given.motion), atol=1e-4)
    assert outside.shape == (20,)
    assert outside.max() < 0.5  # the same dance as the model's statistics


def test_a_motion_outside_the_training_range_is_named(tmp_path: Path, capsys):
    motion = make_motion(SCENE, 20)
    fast = motion._replace(root=motion.root + np.arange(20)[:, None] * [0.3, 0.0, 0.0])  # 9 m/s
    outside, worst = training_range(tiny_model(), SCENE, fast)
    assert outside.max() > 1
    assert "velocity" in worst
    clip = write_clip(tmp_path / "run.h5", motion=fast, attributes={"name": "run"})
    animate_file(tiny_model(), clip, tmp_path / "out.h5", collision=False)
    said = capsys.readouterr().err
    assert "run: frame " in said
    assert "moves faster than in any training motion; it is clamped there" in said
    assert training_range(tiny_model(), SCENE, make_motion(SCENE, 60))[0].max() == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"motion": make_motion(SCENE, 8, fps=60.0)}, "has 60 fps and the model was trained at 30"),
        ({"scene": make_scene(7, 16)}, "a garment of 112 vertices and the model was trained on 128"),
        (
            {"scene": SCENE._replace(garment=SCENE.garment._replace(template=SCENE.garment.template * 1.01))},
            "another garment than the model was trained on: template, faces or UVs",
        ),
        (
            {
                "scene": SCENE._replace(
                    garment=SCENE.garment._replace(faces=SCENE.garment.faces[:, [1, 2, 0]])
                )
            },
            "another garment than the model was trained on: template, faces or UVs",
        ),
        (
            {
                "scene": SCENE._replace(
                    body=SCENE.body._replace(
                        joint_names=tuple(name.replace("LeftLeg", "Knee") for name in SCENE.body.joint_names)
                    )
                )
            },
            "no joint LeftLeg; it has .*rename",
        ),
    ],
)
def test_clips_that_do_not_fit_the_model_are_refused_and_nothing_is_written(tmp_path, change, message):
    clip = write_clip(tmp_path / "clip.h5", 8, **{"scene": SCENE, "motion": make_motion(SCENE, 8), **change})
    with pytest.raises(ValueError, match=message):
        animate_file(tiny_model(), clip, tmp_path / "out.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["clip.h5"]


def test_the_motions_own_file_is_not_overwritten(tmp_path: Path):
    clip = write_clip(tmp_path / "clip.h5", 4)
    with pytest.raises(ValueError, match="holds the motion itself; write the animation to another file"):
        animate_file(tiny_model(), clip, tmp_path / "." / "clip.h5")


def test_a_negative_preroll_is_refused():
    with pytest.raises(ValueError, match="--preroll -3 is negative"):
        frames_of(tiny_model(), make_motion(SCENE, 4), preroll=-3)


def _written(folder: Path, frames: int) -> tuple[np.ndarray, int]:
    """Animate so many frames; return them and the most bytes that NumPy held meanwhile."""
    clip, out = folder / f"{frames}.h5", folder / f"{frames}_out.h5"
    with SequenceWriter(clip, SCENE, make_motion(SCENE, frames), encoding="none"):
        pass
    animate_file(tiny_model(), clip, out, collision=False)  # compiles
    often = gc.get_threshold()
    gc.collect()
    gc.freeze()  # what other tests have left would put off the collector's whole rounds
    gc.set_threshold(100, 2, 2)  # what the collector has not come to yet is no growth
    tracemalloc.start()
    try:
        animate_file(tiny_model(), clip, out, collision=False)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        gc.set_threshold(*often)
    with open_sequence(out) as made, open_sequence(clip) as given:
        np.testing.assert_array_equal(made.motion.rotations, given.motion.rotations)
        return made.read(0, frames), most


def test_memory_does_not_grow_with_a_motions_length(tmp_path: Path, monkeypatch):
    """Rotations alone take 252 bytes a frame of these 7 joints, the networks' inputs as much again."""
    for module in (frame_windows, network_method, sequence_writer):
        monkeypatch.setattr(module, "AT_ONCE", 64)
    short, long = (_written(tmp_path, frames)[1] for frames in (200, 2200))
    # Positions of the root and its heading are a few numbers a frame; what else the process does adds some.
    assert (long - short) / 2000 < 200


def test_frames_are_the_same_in_stretches_of_any_length(tmp_path: Path, monkeypatch):
    whole = _written(tmp_path, 150)[0]
    for module in (frame_windows, network_method, sequence_writer):
        monkeypatch.setattr(module, "AT_ONCE", 64)
    np.testing.assert_allclose(_written(tmp_path, 150)[0], whole, atol=1e-5, rtol=0)
