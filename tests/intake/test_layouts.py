"""One person's motion in the layouts of the large motion libraries, on three bodies, against that person.

The files are written from a ground truth by code of its own (`tests/reference/person.py`, `layouts.py`,
`layout_files.py`), which a reader of its own checks first.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from garment_jax.data.npz import load_body
from garment_jax.embedded.mannequin import make_mannequin
from garment_jax.intake.motions import read_motion
from garment_jax.structs import RiggedBody
from tests.reference.layout_files import joint_worlds, read_layout, resampled, write_layout
from tests.reference.layouts import layout
from tests.reference.limb_judge import Verdict, judge
from tests.reference.person import Performance, make_person, perform

PERSON = make_person()
TRUTH = perform(PERSON)
BVH = ("lafan1", "bandai", "rokoko", "rokoko_own", "mixamo", "cmu_daz", "cmu", "100style", "unreal")
# What is allowed: the project's promise for limbs, floor and path; a trunk of other joints bends elsewhere.
LIMB, TRUNK, HEADING, FLOOR, PATH, KNEE, ELBOW = 0.5, 8.0, 2.0, 0.02, 0.01, 15.0, 35.0


@pytest.fixture(scope="module")
def mannequin() -> RiggedBody:
    return make_mannequin(0.03)


@pytest.fixture(params=["avatar", "mannequin"])
def body(request: pytest.FixtureRequest, mannequin: RiggedBody) -> RiggedBody:
    if request.param == "avatar":
        return load_body(request.getfixturevalue("shared_data") / "avatar" / "avatar.npz")
    return mannequin


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The person's motion in a library's layout, written once."""
    folder, paths = tmp_path_factory.mktemp("layouts"), {}

    def one(name: str) -> Path:
        if name not in paths:
            library = layout(name, PERSON)
            paths[name] = write_layout(folder / f"{name}.bvh", library, truth_at(library.fps))
        return paths[name]

    return one


@cache
def truth_at(fps: float) -> Performance:
    return resampled(TRUTH, fps)


def check(verdict: Verdict) -> None:
    assert verdict.limb < LIMB, verdict
    assert verdict.trunk < TRUNK, verdict
    assert verdict.heading < HEADING, verdict
    assert verdict.floor < FLOOR, verdict
    assert verdict.path < PATH, verdict
    assert verdict.knee < KNEE, verdict
    assert verdict.elbow < ELBOW, verdict


@pytest.mark.parametrize("name", BVH)
def test_the_files_hold_the_person(written: Callable[[str], Path], name: str):
    """The oracle itself: forward kinematics of what was written give the person's joints."""
    library = layout(name, PERSON)
    turns, places = read_layout(written(name))
    expected, where = joint_worlds(library.joints, truth_at(library.fps))
    for k, joint in enumerate(library.joints):
        np.testing.assert_allclose(places[joint.name] * library.metres, where[:, k], atol=1e-5)
        np.testing.assert_allclose(turns[joint.name], expected[:, k], atol=1e-5)


def test_the_person_stands_and_bends_the_knees_forward():
    ends = [PERSON.names.index(side + name) for side in ("Left", "Right") for name in ("Foot", "Toe")]
    np.testing.assert_allclose(TRUTH.positions[:, ends, 1].min(axis=1), 0.025, atol=1e-9)
    for side in ("Left", "Right"):
        middle = (TRUTH.at(f"{side}UpLeg") + TRUTH.at(f"{side}Foot")) / 2
        before = np.einsum("ti,ti->t", TRUTH.at(f"{side}Leg") - middle, TRUTH.turn("Hips")[:, :, 2])
        assert before.min() > 0.05


@pytest.mark.parametrize("name", ["cmu_daz", "cmu"])
def test_a_library_s_motion_is_the_body_s(written: Callable[[str], Path], name: str, body: RiggedBody):
    motion = read_motion(written(name), body, floor=True)
    check(judge(body, motion, truth_at(layout(name, PERSON).fps)))
