"""Which axis is up: a figure of sticks that stands, lies and walks in every world."""

import numpy as np
import pytest

from garment_jax.body.up_axis import TO_Y, axis_name, known_axis, leg_length, settle_up

# metres, Y up, facing +Z
JOINTS = {
    "Hips": (0, 0.9, 0),
    "Neck": (0, 1.4, 0),
    "LeftArm": (0.2, 1.4, 0),
    "RightArm": (-0.2, 1.4, 0),
    "LeftForeArm": (0.5, 1.4, 0),
    "RightForeArm": (-0.5, 1.4, 0),
    "LeftUpLeg": (0.1, 0.9, 0),
    "RightUpLeg": (-0.1, 0.9, 0),
    "LeftLeg": (0.1, 0.5, 0),
    "RightLeg": (-0.1, 0.5, 0),
    "LeftFoot": (0.1, 0.1, 0),
    "RightFoot": (-0.1, 0.1, 0),
}
AT = {name: k for k, name in enumerate(JOINTS)}
FIGURE = np.array(list(JOINTS.values()), float)


def world(axis: str, *, walks: float = 2.0, away: float = 0.0, frames: int = 20) -> np.ndarray:
    """The figure's joints where `axis` is up: it walks along its own front, `away` above the origin."""
    path = np.zeros((frames, 1, 3))
    path[:, 0, 2], path[:, 0, 1] = np.linspace(0, walks, frames), away
    return (FIGURE + path) @ TO_Y[axis]  # the inverse of TO_Y @ v, for rows


@pytest.mark.parametrize("axis", TO_Y)
def test_turns_take_the_axis_up_and_are_rotations(axis: str) -> None:
    turn = TO_Y[axis]
    np.testing.assert_array_equal(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == 1
    unit = (-1.0 if axis[0] == "-" else 1.0) * np.eye(3)["XYZ".index(axis[-1])]
    np.testing.assert_array_equal(turn @ unit, [0, 1, 0])
    assert axis_name(unit + 0.3) == axis


def test_z_up_has_its_front_at_minus_y() -> None:
    np.testing.assert_array_equal(TO_Y["Z"] @ [0, -1, 0], [0, 0, 1])


@pytest.mark.parametrize("axis", TO_Y)
@pytest.mark.parametrize("usual", ["Y", "Z"])
def test_somebody_who_walks_on_the_floor_shows_the_axis(axis: str, usual: str) -> None:
    found = settle_up(world(axis), AT, usual=usual)
    assert found.axis == axis
    assert bool(found.note) == (axis != usual)


def test_somebody_who_lies_is_left_lying() -> None:
    lying = world("Z", walks=0.0, away=-0.9)  # hips at the origin, nothing says that Z is up
    found = settle_up(lying, AT, usual="Y", rest_up="Y")
    assert (found.axis, found.note[:24]) == ("Y", "the body lies along Z wi")


@pytest.mark.parametrize(
    ("away", "rest_up"), [(0.0, "Y"), (0.0, None), (-0.9, "Z")], ids=["floor", "floor, no rest", "rest pose"]
)
def test_what_the_user_says_counts_against_a_single_sign(away: float, rest_up: str | None) -> None:
    positions = world("Z", walks=0.0, away=away)
    assert settle_up(positions, AT, usual="Y", rest_up=rest_up).axis == "Z"
    found = settle_up(positions, AT, usual="Y", said="Y", rest_up=rest_up)
    assert found.axis == "Y"
    assert found.note == (
        "the body lies along Z with Y up, as you say; if it should stand, give --motion-up Z"
    )


@pytest.mark.parametrize(("walks", "rest_up"), [(2.0, "Y"), (2.0, None), (0.0, "Z")])
def test_what_the_motion_shows_beyond_doubt_is_not_overruled(walks: float, rest_up: str | None) -> None:
    with pytest.raises(ValueError, match="stands along Z, not along Y; give --motion-up Z"):
        settle_up(world("Z", walks=walks), AT, usual="Y", said="Y", rest_up=rest_up)


def test_an_axis_without_a_name_of_an_option_is_left_to_the_motion() -> None:
    with pytest.raises(ValueError, match="stands along -Z, not along Y; leave --motion-up out"):
        settle_up(world("-Z"), AT, usual="Y", said="Y")


def test_leg_length_is_that_of_both_legs() -> None:
    assert leg_length(world("Z"), AT) == pytest.approx(1.6)


def test_what_is_no_axis_is_refused_with_its_value():
    assert [known_axis(up) for up in ("z", "-Y", "X")] == ["Z", "-Y", "X"]
    for up in ("w", "", "up"):
        with pytest.raises(ValueError, match=f"the up axis '{up}' is unknown; give X, Y or Z"):
            known_axis(up)
