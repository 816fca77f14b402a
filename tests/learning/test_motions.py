"""Motions to learn from and to keep back: never the same frames, in equal pieces, drawn on when they end."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.learning.motions import Own, Recorded, pieces, training_jobs, with_plain_names
from garment_jax.structs import Motion
from tests.reference.scene import make_motion, make_scene

SCENE = make_scene()


def numbered(frames: int, first: int = 0) -> Motion:
    """A motion whose root says which frame it is."""
    root = np.zeros((frames, 3))
    root[:, 0] = np.arange(first, first + frames)
    return Motion(np.tile(np.eye(3, dtype=np.float32), (frames, 22, 1, 1)), root, 30.0)


def frames_in(motions: dict[str, Motion]) -> list[int]:
    return [int(x) for motion in motions.values() for x in motion.root[:, 0]]


def test_of_few_motions_the_ends_are_kept_back() -> None:
    source = Recorded({"b": numbered(400), "a": numbered(100, 1_000)})
    assert {name: len(m.root) for name, m in source.kept_back(10_000).items()} == {"b_end": 100}
    learnt = source.to_learn(0, 350)
    assert list(learnt) == ["a", "b"]
    assert not set(frames_in(learnt)) & set(frames_in(source.kept_back(10_000)))
    assert len(source.kept_back(60)["b_end"].root) == 60


def test_of_many_a_quarter_is_kept_back_and_named_ones_always() -> None:
    motions = {f"m{k}": numbered(100, 100 * k) for k in range(8)}
    source = Recorded(motions)
    assert list(source.kept_back(10_000)) == ["m2", "m6"]
    assert set(source.to_learn(0, 350)) == set(motions) - {"m2", "m6"}
    assert list(Recorded(motions, ["m0"]).kept_back(200)) == ["m0"]
    assert Recorded(motions, ["m0"]).digest != source.digest
    assert Recorded(dict(motions)).digest == source.digest


def test_what_cannot_be_kept_back_is_refused() -> None:
    with pytest.raises(ValueError, match="--test jump: there is no such motion; there are a, b"):
        Recorded({"a": numbered(300), "b": numbered(300)}, ["jump"])
    with pytest.raises(ValueError, match="--test names all of the 1 motions"):
        Recorded({"a": numbered(300)}, ["a"])
    with pytest.raises(ValueError, match=r"the longest motion has 200 frames, .* give one of 240 or more"):
        Recorded({"a": numbered(200)})


def test_pieces_are_equal_and_come_from_each_motion_in_turn() -> None:
    found = pieces({"long": numbered(700), "short": numbered(90, 5_000)}, 300)
    assert list(found) == ["long_01", "short", "long_02", "long_03"]
    assert [len(motion.root) for motion in found.values()] == [234, 90, 233, 233]
    assert frames_in({k: v for k, v in found.items() if k != "short"}) == list(range(700))


def test_motions_are_drawn_when_the_given_ones_end() -> None:
    motions = {f"m{k}": make_motion(SCENE, 130, seed=k) for k in range(3)}
    source = Recorded(motions, ["m0"])
    few = training_jobs(source, SCENE.body, frames=100, longest=112, seed=0)
    assert [job.name for job in few] == ["m1_01", "m2_01"]
    more = training_jobs(source, SCENE.body, frames=500, longest=112, seed=0)
    assert [job.name for job in more[:5]] == ["m1_01", "m2_01", "m1_02", "m2_02", "drawn_001"]
    assert sum(len(job.motion.root) for job in more) >= 400
    assert max(len(job.motion.root) for job in more) <= 112
    again = training_jobs(source, SCENE.body, frames=500, longest=112, seed=0)
    for a, b in zip(more, again, strict=True):
        np.testing.assert_array_equal(a.motion.rotations, b.motion.rotations)


def test_bodies_of_other_names_have_their_legs_varied_too(tmp_path: Path) -> None:
    names = tuple(f"mixamorig:{name}" for name in SCENE.body.joint_names)
    body = SCENE.body._replace(joint_names=names)
    plain = with_plain_names(body).joint_names
    assert [plain[names.index(f"mixamorig:{n}")] for n in ("LeftUpLeg", "RightLeg")] == [
        "LeftUpLeg",
        "RightLeg",
    ]
    source = Own(body, tmp_path, fps=30.0, seed=0)
    dance = source.kept_back(60)["dance"]
    assert dance.rotations.shape == (60, 22, 3, 3)
    assert not list(tmp_path.iterdir())


def test_the_packages_own_motions_are_figures_and_dances_and_another_dance(tmp_path: Path) -> None:
    source = Own(SCENE.body, tmp_path, fps=30.0, seed=3)
    kept = source.kept_back(240)
    learnt = source.to_learn(2_400, 240)
    assert [len(motion.root) for motion in kept.values()] == [240]
    assert list(learnt)[:3] == ["walk", "turn", "twirl"]
    assert {len(m.root) for m in source.to_learn(400, 112).values()} == {66}
    assert list(learnt)[6:] == ["dancing_001", "dancing_002"]
    for motion in learnt.values():
        assert not np.array_equal(motion.rotations[:100], kept["dance"].rotations[:100])
