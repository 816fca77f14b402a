"""What a prediction may be written to: never a folder, another format, or the work of another command."""

from pathlib import Path

import h5py
import pytest

from garment_jax.io.overwrite_checks import COLLIDED, RESTARTED, check_floor_out, check_prediction_out
from tests.reference.scene import write_clip


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        (".", r"^\. is a folder; name a sequence file"),
        ("..", r"^\.\. is a folder; name a sequence file"),
        ("folder", r"--out folder is a folder; name a sequence file"),
        ("garment.obj", r"does not end in \.h5; name a sequence file, such as garment\.obj\.h5"),
        (f"{'a' * 300}.h5", r"^a{24}… is a name of 303 bytes, more than 255; give a shorter one"),
        (f"{'ä' * 127}.h5", r"is a name of 257 bytes, more than 255"),
        (f"{'b' * 300}/a.h5", r"^b{24}… is a name of 300 bytes, more than 255"),
        ("simulated.h5", r"simulated\.h5 is there and neither infer\.py nor collide wrote it; name another"),
        ("mesh.h5", r"mesh\.h5 is there and neither infer\.py nor collide wrote it"),
    ],
)
def test_what_must_not_be_written_to_is_refused(tmp_path: Path, monkeypatch, out, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "garment.obj").write_text("v 0 0 0\n")
    (tmp_path / "mesh.h5").write_text("v 0 0 0\n")
    write_clip("simulated.h5", 2)
    with pytest.raises(ValueError, match=sentence):
        check_prediction_out(Path(out))


def test_ones_own_work_and_new_names_may_be_written(tmp_path: Path):
    check_prediction_out(tmp_path / "not" / "there" / "yet.h5")
    check_prediction_out(tmp_path / f"{'a' * 237}.h5")
    check_prediction_out(write_clip(tmp_path / "predicted.h5", 2, attributes={"kind": "predicted"}))
    collided = write_clip(tmp_path / "collided.h5", 2)
    with h5py.File(collided, "r+") as file:
        file.attrs[COLLIDED] = 0.004
    check_prediction_out(collided)


def test_floor_replaces_its_own_work_alone(tmp_path: Path):
    check_floor_out(tmp_path / "new.h5")
    clip = write_clip(tmp_path / "clip.h5", 2, attributes={"kind": "simulated"})
    with pytest.raises(ValueError, match=r"clip\.h5 is there and floor did not write it; name another --out"):
        check_floor_out(clip)
    with pytest.raises(ValueError, match=r"does not end in \.h5"):
        check_floor_out(tmp_path / "again.json")
    with h5py.File(clip, "r+") as file:
        file.attrs[RESTARTED] = 100
    check_floor_out(clip)
    with h5py.File(clip, "r+") as file:
        file.attrs[COLLIDED] = 0.004
    with pytest.raises(ValueError, match="floor did not write it"):
        check_floor_out(clip)  # collide has kept the attributes of what it read
