"""Where a rest pose at the beginning of a motion ends: at the jump, not at the last brisk frame."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.body.bvh import read_bvh
from garment_jax.validation.fixes import fix_file
from garment_jax.validation.track_checks import check_track
from tests.importers.test_jumps import speeds

# the last jump of captures at 120 frames a second, found by eye in their joints' speeds
JUMPS = {"indian_06": 3, "martial_04": 5, "salsa_16": 4}


def test_finding_names_the_frames_and_the_jump() -> None:
    x = np.cumsum(np.concatenate([[0.0], speeds(107.0, *[4.7] * 7) / 120]))
    points = np.zeros((len(x), 2, 3))
    points[:, 0, 0] = x
    found = next(f for f in check_track(points, 120.0) if f.check == "rest pose")
    assert found.repair is not None
    assert found.repair.amount == 1
    assert found.where == "frame 0 to 1"
    assert "drop the first frame (--fix does" in found.remedy


def test_walk_loses_one_frame(shared_cases: Path, tmp_path: Path) -> None:
    source = shared_cases / "fix_drops_real_frames" / "walk.bvh"
    fixed = fix_file(source, [source], tmp_path)
    assert fixed.done == ["the first frame dropped"]
    assert fixed.path is not None
    before, after = read_bvh(source), read_bvh(fixed.path)
    assert len(after.root) == len(before.root) - 1
    np.testing.assert_allclose(after.root, before.root[1:])


@pytest.mark.parametrize("name", JUMPS)
def test_captures_lose_their_rest_pose(name: str, shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "motion" / f"{name}.bvh"
    fixed = fix_file(source, [source], tmp_path)
    assert f"the first {JUMPS[name]} frames dropped" in fixed.done
