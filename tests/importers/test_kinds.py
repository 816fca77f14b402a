"""What a path is: told by suffix and content, several kinds apart, nothing executed."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.importers.kinds import find_kind, in_order, list_clips
from tests.importers.good_files import write_all
from tests.io.packed import write_packed
from tests.reference.scene import write_clip


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_all(tmp_path_factory.mktemp("case"))


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("skirt", "vto"),
        ("skirt/simulations", "vto"),
        ("skirt/simulations/walk.pkl", "vto"),
        ("dress02", "virtualbones"),
        ("dress02/1.npz", "virtualbones"),
        ("walk.pc2", "meshes"),
        ("walk.mdd", "meshes"),
        ("walk", "meshes"),
        ("walk.ply", "meshes"),
        ("walk.bvh", "motion"),
        ("amass.npz", "motion"),
        ("aist.pkl", "motion"),
        ("me.glb", "motion"),
    ],
)
def test_each_format_is_recognised(case: Path, name: str, kind: str):
    assert find_kind([case / name]) == kind


def test_packed_clips_are_recognised(tmp_path: Path):
    clip = write_packed(tmp_path)
    assert find_kind([clip]) == find_kind([clip.parent]) == "packed"


def test_a_sequence_file_is_a_motion(tmp_path: Path):
    clip = write_clip(tmp_path / "seq.h5", 3)
    assert find_kind([tmp_path / "seq.h5"]) == find_kind([tmp_path]) == "motion", clip
    assert list_clips([tmp_path], "motion") == [tmp_path / "seq.h5"]


def test_a_cache_with_its_meshes_is_one_clip(tmp_path: Path):
    for name in ("seq.pc2", "seq.obj", "seq_body.pc2", "seq_body.obj", "some_body.pc2"):
        (tmp_path / name).touch()
    assert list_clips([tmp_path], "meshes") == [tmp_path / "seq.pc2", tmp_path / "some_body.pc2"]


def test_folders_list_their_clips(case: Path, tmp_path: Path):
    assert list_clips([case / "skirt"], "vto") == [case / "skirt/simulations/walk.pkl"]
    assert list_clips([case / "dress02"], "virtualbones") == [case / "dress02/1.npz"]
    assert list_clips([case / "walk"], "meshes") == [case / "walk"]
    assert list_clips([case / "walk.pc2", case / "walk.pc2"], "meshes") == [case / "walk.pc2"]
    for name in ("clip_10.pc2", "clip_2.pc2", ".clip_1.pc2"):
        (tmp_path / name).touch()
    assert [path.name for path in list_clips([tmp_path], "meshes")] == ["clip_2.pc2", "clip_10.pc2"]


def test_names_are_sorted_as_people_count():
    names = [Path(name) for name in ("b10", "b9", "a", "b²", "b1x2", "b1x10")]
    assert [path.name for path in in_order(names)] == ["a", "b1x2", "b1x10", "b9", "b10", "b²"]


def test_what_is_none_of_them_is_refused(case: Path, tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"gone\.pc2 is not there; name files or folders"):
        find_kind([tmp_path / "gone.pc2"])
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(ValueError, match=r"notes\.txt is of no format that is known; it reads packed clips"):
        find_kind([tmp_path / "notes.txt"])
    with pytest.raises(ValueError, match=r"no format that is known"):
        find_kind([tmp_path])
    with pytest.raises(ValueError, match=r"walk\.bvh is of format motion and .*walk\.pc2 of format meshes"):
        find_kind([case / "walk.bvh", case / "amass.npz", case / "walk.pc2"])
    with pytest.raises(
        FileNotFoundError, match=r"holds no simulations \(\.pkl\); name the clips' own folder"
    ):
        list_clips([case / "walk"], "vto")


def test_a_file_too_damaged_to_tell_its_kind_goes_with_the_others(tmp_path: Path):
    clips = [write_clip(tmp_path / f"{name}.h5", 2) for name in "abc"]
    clips[1].write_bytes(b"\x89HDF\r\n")
    assert find_kind(clips) == "motion"
    (tmp_path / "1.npz").write_bytes(b"PK")
    np.savez(tmp_path / "2.npz", pose=np.zeros(3), sim_res=np.zeros(3))
    assert find_kind([tmp_path / "1.npz", tmp_path / "2.npz"]) == "virtualbones"
    assert find_kind([clips[1]]) == "packed"
