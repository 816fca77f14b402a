"""Which reader a path gets."""

from pathlib import Path

import pytest

from garment_jax.io.formats.any_mesh_cache import read_cache


def test_paths_that_are_no_animated_mesh(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match="is not there"):
        read_cache(tmp_path / "a.pc2")
    (tmp_path / "a.fbx").touch()
    with pytest.raises(ValueError, match=r"\.fbx is no animated mesh"):
        read_cache(tmp_path / "a.fbx")
