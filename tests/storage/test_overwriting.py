"""What is there is replaced with force alone."""

from pathlib import Path

import pytest

from garment_jax.storage.overwriting import check_free
from garment_jax.storage.scratch import make_scratch


def test_what_is_there_is_replaced_with_force_alone(tmp_path: Path):
    (tmp_path / "a.h5").write_text("")
    (tmp_path / "link.h5").symlink_to("nowhere.h5")
    (tmp_path / "frames").mkdir()
    check_free(tmp_path / "frames", False, frames=True)
    check_free(tmp_path / "new.h5", False)
    (tmp_path / "frames" / "garment_0000.obj").write_text("")
    for name in ("a.h5", "link.h5", "frames"):
        with pytest.raises(ValueError, match=f"{name} is there already; --force replaces it, or"):
            check_free(tmp_path / name, False, frames=True)
        check_free(tmp_path / name, True, frames=True)
    (tmp_path / "frames" / "notes.txt").write_text("")
    for force in (False, True):
        with pytest.raises(ValueError, match="frames is a folder that holds other files; name another --out"):
            check_free(tmp_path / "frames", force, frames=True)


def test_what_a_killed_run_left_beside_its_file_is_removed(tmp_path: Path, monkeypatch):
    (tmp_path / "a.h5").write_text("")
    left = make_scratch(tmp_path)
    with pytest.raises(ValueError, match="is there already"):
        check_free(tmp_path / "a.h5", False)
    assert left.is_dir()  # of a process that lives
    monkeypatch.setattr("garment_jax.storage.scratch.is_dead", lambda process: True)
    with pytest.raises(ValueError, match="is there already"):
        check_free(tmp_path / "a.h5", False)
    assert not left.exists()
