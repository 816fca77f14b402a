from contextlib import ExitStack

import numpy as np
import pytest

from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.viewer.shown_clips import choose
from tests.reference.scene import make_motion, make_scene, write_clip


@pytest.fixture
def opened(tmp_path):
    scene, stack = make_scene(), ExitStack()

    def make(name, *, kind="predicted", frames=6, scene=scene, motion=None, **options):
        motion = motion or make_motion(scene, frames)
        path = tmp_path / f"{name}.h5"
        write_clip(path, scene=scene, motion=motion, attributes={"kind": kind}, **options)
        return stack.enter_context(open_sequence(path))

    with stack:
        yield make


def test_the_last_simulated_file_is_the_truth(opened):
    clips = [opened("a", kind="simulated"), opened("b", kind="simulated"), opened("c")]
    assert choose(clips).truth == 1
    assert choose(clips, truth=clips[2].path).truth == 2
    assert choose(clips[:1]).truth is None
    with pytest.raises(ValueError, match=r"--truth nowhere\.h5 is not among the files"):
        choose(clips, truth="nowhere.h5")


def test_predictions_alone_have_no_error_and_say_so(opened):
    shown = choose([opened("a"), opened("b")])
    assert shown.truth is None
    assert "name the truth with --truth" in shown.notes[0]


def test_the_shorter_clip_decides_and_that_is_said(opened):
    shown = choose([opened("long", frames=9), opened("short", kind="simulated", frames=6)])
    assert shown.frames.tolist() == list(range(6))
    assert shown.notes == ["The clips differ in length; the 6 frames of short.h5 are shown."]


def test_every_other_frame_at_half_the_rate(opened):
    shown = choose([opened("a")], start=1, stop=6, every=2)
    assert shown.frames.tolist() == [1, 3, 5]
    assert shown.fps == 15


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"every": 0}, "--every 0 must be 1 or more"),
        ({"start": 6}, "a.h5 has 6 frames; --start 6 --stop 6 must fit"),
        ({"start": 4, "stop": 4}, "--start 4 --stop 4 must fit"),
        ({"stop": 7}, "--start 0 --stop 7 must fit"),
        ({"start": -1}, "--start -1 --stop 6 must fit"),
    ],
)
def test_frames_that_there_are_none_of_are_refused(opened, settings, words):
    with pytest.raises(ValueError, match=words):
        choose([opened("a")], **settings)


def test_clips_that_do_not_belong_together_are_refused(opened):
    one, scene = opened("one"), make_scene()
    with pytest.raises(
        ValueError, match=r"one\.h5 has 128 vertices but .*other\.h5 has 96; compare clips of one garment"
    ):
        choose([opened("other", scene=make_scene(6, 16)), one])
    flipped = scene._replace(garment=scene.garment._replace(faces=scene.garment.faces[:, ::-1].copy()))
    with pytest.raises(ValueError, match=r"faces of .*one.* and .*flipped.* differ in vertices"):
        choose([opened("flipped", scene=flipped), one])
    with pytest.raises(ValueError, match=r"one\.h5 runs at 30 fps but .*slow\.h5 at 25"):
        choose([opened("slow", motion=make_motion(scene, 6)._replace(fps=25.0)), one])
    with pytest.raises(ValueError, match=r"motions of .*one\.h5 and .*elsewhere\.h5 differ at frame"):
        choose([opened("elsewhere", motion=make_motion(scene, 6, seed=3)), one])


def test_a_motion_without_garment_is_refused(tmp_path):
    scene = make_scene()
    with SequenceWriter(tmp_path / "m.h5", scene, make_motion(scene, 3), encoding="none"):
        pass
    with (
        open_sequence(tmp_path / "m.h5") as clip,
        pytest.raises(ValueError, match=r"animate it with infer\.py"),
    ):
        choose([clip])


def test_another_body_is_said(opened):
    scene = make_scene()
    taller = scene._replace(body=scene.body._replace(vertices=scene.body.vertices * np.float32(1.01)))
    shown = choose([opened("tall", scene=taller), opened("truth", kind="simulated")])
    assert shown.notes == ["tall.h5 has another body; that of truth.h5 is drawn."]
