"""Opening a run: the data are prepared once, and what does not belong together is refused."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.config import Config, DataConfig
from garment_jax.io.content_hash import garment_hash
from garment_jax.structs import Motion
from garment_jax.training.run import checkpointer, open_run
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion, make_scene, write_clip

ALONE = replace(CONFIG, data=DataConfig(validation=()))


def write(folder: Path, name: str, frames: int = 9, **options) -> Path:
    """Write a training clip of the tiny scene, vertices in float32 so that they can be spoilt."""
    motion = options.pop("motion", None) or make_motion(SCENE, frames, seed=len(name))
    options = {"scene": SCENE, "encoding": "float32", "attributes": {"name": name}} | options
    return write_clip(folder / "train" / f"{name}.h5", motion=motion, **options)


def open_(folder: Path, config: Config = ALONE):
    run = open_run(config, folder / "run", data_dir=folder)
    run.log.close()
    return run


def test_clips_are_prepared_once_and_described_in_every_checkpoint(tmp_path: Path, capsys):
    write(tmp_path, "waltz")
    first = open_(tmp_path)
    assert "prepare: waltz, 9 frames" in capsys.readouterr().err
    again = open_(tmp_path)
    assert "prepare" not in capsys.readouterr().err
    assert again.data.content == first.data.content
    assert [clip.name for clip in again.data.train] == ["waltz", "waltz mirrored"]
    np.testing.assert_array_equal(again.data.train[0].V, first.data.train[0].V)
    saved = checkpointer(first, "toy")
    saved.save(1, {"x": np.zeros(1)})
    described = saved.metadata()["metadata"]
    assert described["garment_hash"] == garment_hash(SCENE.garment)
    assert (described["vertices"], described["fps"]) == (128, 30.0)
    assert described["statistics"]["map_mean"] == np.asarray(first.data.statistics.map_mean).tolist()
    assert described["config"]["motion"]["gru"] == CONFIG.motion.gru


def test_another_configuration_garment_or_data_set_is_refused(tmp_path: Path):
    write(tmp_path, "waltz")
    open_(tmp_path)
    other = replace(ALONE, motion=replace(ALONE.motion, gru=17))
    with pytest.raises(ValueError, match=r"another run \(motion\.gru = 16, not 17\); use another --run-dir"):
        open_(tmp_path, other)
    write(tmp_path, "salsa")
    with pytest.raises(ValueError, match=r"belongs to another run \(data = '.*', not '.*'\)"):
        open_(tmp_path)


def test_a_run_of_another_garment_is_refused_with_its_cache_as_it_was(tmp_path: Path, capsys):
    write(tmp_path, "waltz")
    open_(tmp_path)
    garment = SCENE.garment._replace(template=1.01 * SCENE.garment.template)
    write(tmp_path / "other", "jive", scene=SCENE._replace(garment=garment))
    before, _ = sorted((tmp_path / "run" / "cache").iterdir()), capsys.readouterr()
    with pytest.raises(ValueError, match=r"belongs to another run \(garment = '.*', not '.*'\)"):
        open_run(ALONE, tmp_path / "run", data_dir=tmp_path / "other")
    assert "prepare" not in capsys.readouterr().err
    assert sorted((tmp_path / "run" / "cache").iterdir()) == before


def spoil(path: Path, frame: int, vertex: int, value: float) -> None:
    with h5py.File(path, "r+") as file:
        file["vertices"][frame, vertex, 1] = value


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_vertices_that_are_not_finite_name_clip_and_frame(tmp_path: Path, value: float):
    write(tmp_path, "waltz")
    spoil(write(tmp_path, "salsa"), 6, 3, value)
    with pytest.raises(ValueError, match=r"salsa\.h5: vertex 3 of frame 6 is .*; cut the clip before"):
        open_(tmp_path)
    assert not (tmp_path / "run" / "config.toml").exists()


def still() -> Motion:
    return Motion(np.tile(np.eye(3, dtype=np.float32), (9, 22, 1, 1)), np.ones((9, 3)), 30.0)


def large(motion: Motion) -> dict:
    """The same clip in centimetres."""
    garment, body = SCENE.garment, SCENE.body
    body = body._replace(vertices=body.vertices * 100, joints=body.joints * 100)
    scene = SCENE._replace(garment=garment._replace(template=garment.template * 100), body=body)
    return {"scene": scene, "motion": motion._replace(root=motion.root * 100)}


def renamed() -> dict:
    names = tuple(name.replace("LeftLeg", "Knee") for name in SCENE.body.joint_names)
    return {"scene": SCENE._replace(body=SCENE.body._replace(joint_names=names))}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"motion": still()}, r"bad\.h5 is static: its 9 frames hold one pose; leave it out"),
        (large(make_motion(SCENE, 9)), "m large, which looks like centimetres or millimetres; convert"),
        (renamed(), "no joint '?LeftLeg'?; it has"),
        ({"motion": make_motion(SCENE, 9, fps=60.0)}, "has 60 fps and .* 30; resample one"),
        ({"scene": make_scene(7, 16)}, "garment vertices"),
        (
            {"scene": SCENE._replace(garment=SCENE.garment._replace(faces=SCENE.garment.faces[::-1]))},
            "`faces`",
        ),
    ],
)
def test_clips_that_cannot_be_learnt_from_are_refused(tmp_path: Path, options: dict, message: str):
    if "fps" in message or "garment" in message or "faces" in message:
        write(tmp_path, "a_good_one")  # they are refused beside another clip
    write(tmp_path, "bad", **options)
    with pytest.raises(ValueError, match=message):
        open_(tmp_path)
    assert not list((tmp_path / "run").glob("cache/bad*.npy"))


def test_folders_without_clips_and_unknown_validation_clips_are_refused(tmp_path: Path):
    with pytest.raises(ValueError, match=r"holds no training clips \(\*\.h5\); import or simulate some"):
        open_(tmp_path)
    write(tmp_path, "waltz")
    with pytest.raises(
        ValueError, match=r"data\.validation names 'waltz_3', which .* does not hold; it has waltz"
    ):
        open_(tmp_path, CONFIG)
    with pytest.raises(ValueError, match=r"data\.validation names every clip; leave some to train on"):
        open_(tmp_path, replace(CONFIG, data=DataConfig(validation=("waltz",))))
