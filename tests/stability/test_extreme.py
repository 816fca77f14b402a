import numpy as np
import pytest

from garment_jax.body.root_frame import heading
from garment_jax.stability import extreme
from garment_jax.stability.case import GREEN, LEFT_OUT, RED
from garment_jax.stability.extreme_motions import SHAKE_G, TELEPORT, calmest_pose, extreme_motions
from garment_jax.stability.script import HOLD, SLOWLY, Part, make_script
from garment_jax.structs import Motion
from tests.animation.tiny_model import CONFIG, SCENE
from tests.stability.small import reds, small_subject

CALM = calmest_pose(small_subject().motions, SCENE.body)
PARTS = extreme_motions(small_subject(), CALM, CONFIG.body.motion_joints)


PLACE = Part("part", 10, 60, 100, 190)


def watched(t: int = 200) -> extreme.Watched:
    """Return what a garment 60 cm long shows that never moves."""
    bad, strain, stretch, apart = np.zeros((4, t))
    return extreme.Watched(bad, strain, stretch, apart, np.full(t, -57.0), {})


def part(name: str) -> Motion:
    return next(motion for known, motion in PARTS if name in known)


def fastest(motion: Motion) -> tuple[float, float]:
    """Return the root's largest step (metres) and the largest turn of a joint (radians) in a frame."""
    turned = np.einsum("tjab,tjac->tjbc", motion.rotations[:-1], motion.rotations[1:]).astype(np.float64)
    cosine = (np.trace(turned, axis1=-2, axis2=-1) - 1) / 2
    step = np.linalg.norm(np.diff(motion.root, axis=0), axis=1)
    return float(step.max()), float(np.arccos(np.clip(cosine, -1, 1)).max())


def test_the_motions_are_as_extreme_as_they_say():
    names = [name for name, _ in PARTS]
    assert names[:3] == ["waltz at 1x", "waltz at 2x", "waltz at 4x"]
    assert not any(name.startswith("Right") for name in names)
    assert len(part("4x").root) == pytest.approx(len(part("1x").root) / 4, abs=1)
    acceleration = np.diff(part("10 g").root[:, 0], 2) * CALM.fps**2
    assert np.abs(acceleration).max() == pytest.approx(9.81 * SHAKE_G)
    steps = np.linalg.norm(np.diff(part("teleported").root, axis=0), axis=1)
    assert steps.max() == pytest.approx(np.linalg.norm(TELEPORT))
    knee = SCENE.body.joint_names.index("LeftLeg")
    relative = CALM.rotations[0, knee].T @ part("LeftLeg turned").rotations[0, knee]
    assert np.trace(relative) == pytest.approx(-1.0, abs=1e-5)  # half a turn


def test_a_script_begins_slowly_joins_without_a_jump_and_ends_every_part_calm():
    motion, places = make_script(CALM, PARTS[:2])
    assert [p.name for p in places] == ["calm pose reached slowly", "waltz at 1x", "waltz at 2x"]
    assert places[0].start == SLOWLY + 1
    assert places[-1].end == len(motion.root)
    # nothing is faster than the waltz at twice its speed: no jump where parts meet
    for whole, alone in zip(fastest(motion), fastest(PARTS[1][1]), strict=True):
        assert whole == pytest.approx(alone, rel=1e-3)
    for p in places:
        held = motion.rotations[p.calm : p.end]
        assert len(held) == HOLD
        np.testing.assert_allclose(held, np.broadcast_to(held[:1], held.shape), atol=1e-6)
        local = np.swapaxes(held[0, :1], -1, -2) @ held[0]
        np.testing.assert_allclose(
            local, np.swapaxes(CALM.rotations[0, :1], -1, -2) @ CALM.rotations[0], atol=1e-5
        )
    assert np.isfinite(heading(motion.rotations[:, 0])).all()


def test_without_a_model_or_with_another_garments_the_rollouts_are_left_out_with_the_reason():
    cases = extreme.extreme_cases(small_subject()).cases
    assert [(c.verdict, c.value) for c in cases] == [(LEFT_OUT, "no RUN given")]
    trained = small_subject(trained=True)
    assert trained.model is not None
    other = trained._replace(model=trained.model._replace(vertices=7))
    (case,) = extreme.extreme_cases(other).cases
    assert "a garment of 128 vertices and the model was trained on 7" in str(case.value)


def test_the_whole_group_runs_and_a_wrong_frame_rate_is_refused():
    found = extreme.extreme_cases(small_subject(trained=True), collision=False)
    said = {c.case: c.verdict for c in found.cases if c.quantity == "refused"}
    assert said == dict.fromkeys(
        [
            "a motion at 15 fps for a 30 fps model",
            "a motion at 120 fps for a 30 fps model",
            "a file whose root jumps 5 m",
        ],
        GREEN,
    )
    first = found.cases[0]
    assert (first.quantity, first.verdict) == ("numbers that are not finite", GREEN)
    names = {c.case for c in found.cases}
    assert {"frozen pose, 300 frames", "looped waltz, 1000 frames"} <= names
    drifts = [c for c in found.cases if "drift" in c.quantity]
    assert [c.verdict for c in drifts] == [GREEN, GREEN]
    assert {curve.plot for curve in found.curves} == {"strain", "recovery"}


@pytest.mark.parametrize(
    ("field", "value", "red"),
    [("apart", 11.0, "shape back"), ("hem", -59.0, "hem back"), ("bad", 1.0, "strain back")],
)
def test_what_is_measured_decides_the_verdicts(field: str, value: float, red: str):
    seen = watched()
    assert reds(extreme._part_cases(PLACE, seen, 60.0, -57.0)) == []
    getattr(seen, field)[10:190] = value
    (line,) = reds(extreme._part_cases(PLACE, seen, 60.0, -57.0))
    assert red in line
    seen.strain[20] = np.nan
    assert extreme._part_cases(PLACE, seen, 60.0, -57.0)[0].verdict == RED


@pytest.mark.parametrize(("field", "red"), [("strain", "edge strain, p99"), ("stretch", "stretch, p99")])
def test_a_garment_that_stays_strained_is_not_back_to_normal(field: str, red: str):
    seen = watched()
    getattr(seen, field)[10:190] = 31.0
    lines = reds(extreme._part_cases(PLACE, seen, 60.0, -57.0))
    assert len(lines) == 2
    assert red in lines[0]
    assert "strain back to normal" in lines[1]


def test_the_way_back_to_normal_is_counted_to_the_last_frame_that_is_not():
    seen = watched()
    seen.apart[[110, 130]] = 12.0
    case = extreme._part_cases(PLACE, seen, 60.0, -57.0)[2]
    assert (case.quantity, case.value, case.verdict) == ("shape back to normal after", 31.0, GREEN)
    before = seen._replace(apart=np.full(200, np.nan))  # of the first part, while it is reached slowly
    assert len(extreme._part_cases(PLACE, before, 60.0, -57.0)) == 2
