import itertools
import re
import tracemalloc

import numpy as np
import pytest

from garment_jax.body.bvh import read_bvh
from garment_jax.body.skeleton_track import world_positions

HIERARCHY = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Upper Arm
  {
    OFFSET 1 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Hand {
      OFFSET 0 2 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0 0 9
      }
    }
  }
}
"""
REST = " ".join(["0"] * 12)


def frames_of(*rows: str, count: object = None, time: object = 0.008) -> str:
    announced = len(rows) if count is None else count
    return f"MOTION\nFrames: {announced}\nFrame Time: {time}\n" + "\n".join(rows)


def turn(axis: str, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return {
        "X": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "Y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "Z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def one_joint(tmp_path, channels: str, row: str):
    head = f"HIERARCHY\nROOT A\n{{\nOFFSET 1 2 3\nCHANNELS {len(channels.split())} {channels}\n}}\n"
    (tmp_path / "one.bvh").write_text(head + frames_of(row))
    return read_bvh(tmp_path / "one.bvh")


@pytest.mark.parametrize("order", ["".join(order) for order in itertools.permutations("XYZ")])
def test_rotations_follow_the_channels_whatever_their_order(tmp_path, order):
    channels = " ".join(f"{axis}rotation" for axis in order)
    for axis, image in (("X", [1, 0, 0]), ("Y", [0, 0, -1]), ("Z", [0, 1, 0])):
        row = " ".join("90" if axis == name else "0" for name in order)
        clip = one_joint(tmp_path, channels, row)
        np.testing.assert_allclose(clip.rotations[0, 0] @ [1, 0, 0], image, atol=1e-12)
    clip = one_joint(tmp_path, channels, "20 -50 130")
    # the first channel is applied last
    expected = turn(order[0], 20) @ turn(order[1], -50) @ turn(order[2], 130)
    np.testing.assert_allclose(clip.rotations[0, 0], expected, atol=1e-12)
    np.testing.assert_array_equal(clip.root, [[1, 2, 3]])


def test_positions_may_stand_anywhere_among_the_channels(tmp_path):
    clip = one_joint(tmp_path, "Zposition yrotation XPOSITION", "7 90 5")
    np.testing.assert_array_equal(clip.root, [[5, 2, 7]])
    np.testing.assert_allclose(clip.rotations[0, 0], turn("Y", 90), atol=1e-12)


def test_a_chains_end_is_where_the_closed_form_puts_it(tmp_path):
    # hips turned by 90 degrees about Z, the arm by -90 about X: the hand is 2 along -Z
    rows = ("10 20 30 90 0 0 0 -90 0 0 0 0", REST)
    path = tmp_path / "chain.bvh"
    path.write_text(HIERARCHY + frames_of(*rows))
    clip = read_bvh(path)
    assert clip.joint_names == ("Hips", "Upper Arm", "Hand")
    np.testing.assert_array_equal(clip.parents, [-1, 0, 1])
    np.testing.assert_array_equal(clip.offsets, [[0, 0, 0], [1, 0, 0], [0, 2, 0]])
    assert clip.frame_time == 0.008
    arm = clip.root + clip.rotations[:, 0] @ clip.offsets[1]
    hand = arm + clip.rotations[:, 1] @ clip.offsets[2]
    np.testing.assert_allclose(arm, [[10, 21, 30], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(hand, [[10, 21, 28], [1, 2, 0]], atol=1e-12)


def test_layout_and_positions_of_other_joints_do_not_matter(tmp_path):
    plain, odd = tmp_path / "plain.bvh", tmp_path / "odd.bvh"
    row = "1 2 3 10 20 30 40 50 60 70 80 90"
    plain.write_text(HIERARCHY + frames_of(row))
    six = HIERARCHY.replace("OFFSET 1 0 0\n    CHANNELS 3", "OFFSET 1 0 0\n CHANNELS 4 Yposition")
    moved = "1 2 3 10 20 30 -99 40 50 60 70 80 90"
    dense = six.replace("\n  {", "{") + frames_of(moved) + "\n\n"
    odd.write_bytes(b"\xef\xbb\xbf" + dense.replace("\n", "\r\n").replace(" ", "\t", 40).encode())
    expected, found = read_bvh(plain), read_bvh(odd)
    for name in ("parents", "offsets", "rotations", "root"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("solid cube\n", "is not a BVH file: it needs a HIERARCHY"),
        ("", "is not a BVH file"),
        (HIERARCHY, "and then a MOTION section"),
        ("HIERARCHY\n" + frames_of(REST), "it needs joints, each with a name of its own"),
        (HIERARCHY.replace("Hand", "Hips") + frames_of(REST), "each with a name of its own"),
        (HIERARCHY + "JOINT Tail {\n}\n" + frames_of(REST), "one ROOT must hold all joints"),
        (HIERARCHY + "ROOT Tail {\n}\n" + frames_of(REST), "one ROOT must hold all joints"),
        (HIERARCHY[:-2] + frames_of(REST), "it ends early; export the file again"),
        (HIERARCHY + "}\n" + frames_of(REST), "its braces do not match"),
        (HIERARCHY.replace("CHANNELS 6", "CHANNELS 5") + frames_of(REST), "unexpected 'Yrotation'"),
        (HIERARCHY.replace("Zposition", "Wposition") + frames_of(REST), "unknown or repeated channels"),
        (HIERARCHY.replace("Zposition", "Yposition") + frames_of(REST), "unknown or repeated channels"),
        (
            HIERARCHY.replace("OFFSET 1 0", "OFFSET 1 x") + frames_of(REST),
            "could not convert string to float",
        ),
        (HIERARCHY.replace("OFFSET 1 0", "OFFSET 1 inf") + frames_of(REST), "an OFFSET is not finite"),
        (HIERARCHY + "MOTION\n" + REST, "'Frames:' and 'Frame Time:' must follow MOTION"),
        (HIERARCHY + frames_of(REST, count="two"), "the frames' header cannot be read"),
        (HIERARCHY + frames_of(count=0), "announces 0 frames; a clip has at least one"),
        (HIERARCHY + frames_of(REST, count=2), "announces 2 frames and holds 1; it is cut off or edited"),
        (HIERARCHY + frames_of(REST, REST[:-2]), "frame 1 holds 11 numbers for 12 channels"),
        (HIERARCHY + frames_of(REST + " 0"), "frame 0 holds 13 numbers for 12 channels"),
        (HIERARCHY + frames_of(REST, REST[:-1] + "x"), "the frames hold no numbers: could not convert"),
        (HIERARCHY + frames_of(REST, REST[:-1] + "nan"), "frame 1 holds NaN or infinity; cut that part out"),
        (HIERARCHY + frames_of(REST[:-1] + "1e999"), "frame 0 holds NaN or infinity"),
        (HIERARCHY + frames_of(REST, time=0), "a frame time of 0 s is absurd; write 0.0001 to 1"),
        (HIERARCHY + frames_of(REST, time=-0.01), "a frame time of -0.01 s is absurd"),
        (HIERARCHY + frames_of(REST, time=30), "a frame time of 30 s is absurd"),
        (HIERARCHY + frames_of(REST, time="nan"), "a frame time of nan s is absurd"),
    ],
)
def test_what_is_no_motion_is_refused(tmp_path, text, sentence):
    (tmp_path / "bad.bvh").write_text(text)
    with pytest.raises(ValueError, match=re.escape(sentence)) as raised:
        read_bvh(tmp_path / "bad.bvh")
    assert "bad.bvh" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_count_that_no_memory_holds_is_refused_by_the_rows_found(tmp_path):
    (tmp_path / "huge.bvh").write_text(HIERARCHY + frames_of(REST, count=10**15))
    with pytest.raises(ValueError, match=f"announces {10**15} frames and holds 1; it is cut off"):
        read_bvh(tmp_path / "huge.bvh")


def test_rows_beyond_those_announced_are_left_out_with_a_note(tmp_path):
    (tmp_path / "more.bvh").write_text(HIERARCHY + frames_of(REST, REST.replace("0", "9"), "", count=1))
    clip = read_bvh(tmp_path / "more.bvh")
    assert clip.notes == ("1 rows more than the 1 frames announced are left out",)
    np.testing.assert_array_equal(clip.root, [[0, 0, 0]])


BELOW = """HIERARCHY
ROOT reference
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Hips
  {
    OFFSET 0 95 0
    CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
    JOINT Spine
    {
      OFFSET 0 0 0
      CHANNELS 3 Xposition Yposition Zposition
    }
    JOINT Tail
    {
      OFFSET 0 0 -7
      CHANNELS 3 Xposition Yposition Zposition
    }
  }
}
"""


def test_position_channels_count_down_to_the_hips_and_where_the_offset_is_zero(tmp_path):
    # reference at (1, 0, 0) turned by 90 degrees about Y takes +Z to +X; then the hips' own place
    row = "1 0 0 0 0 90  0 90 5 0 0 0  0 12 0  99 99 99"
    path = tmp_path / "below.bvh"
    path.write_text(BELOW + frames_of(row))
    clip = read_bvh(path)
    points = world_positions(clip)[0]
    np.testing.assert_allclose(points, [[1, 0, 0], [6, 90, 0], [6, 102, 0], [-1, 90, 0]], atol=1e-9)
    np.testing.assert_allclose(clip.offsets, [[0, 0, 0], [0, 95, 0], [0, 12, 0], [0, 0, -7]])
    # channels that are 0 throughout say nothing: the hips stay where their OFFSET has them
    path.write_text(BELOW + frames_of("1 0 0 0 0 90  0 0 0 0 0 0  0 12 0  99 99 99"))
    np.testing.assert_allclose(world_positions(read_bvh(path))[0, 1], [1, 95, 0], atol=1e-9)


@pytest.mark.parametrize("kind", ["joints", "nesting", "count", "channels", "name", "line"])
def test_what_would_fill_the_memory_is_refused_within_500_mb(tmp_path, kind):
    flat = "ROOT A\n{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n%s}\n"
    joints = "".join(f"JOINT b{k}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n}}\n" for k in range(20_000))
    text = {
        "joints": flat % joints[: joints.index("JOINT b9000")] + frames_of(*["0"] * 5_000),
        "nesting": "ROOT A\n{\n" + "JOINT b\n{\n" * 200_000,
        "count": flat % "" + frames_of("0", count="9" * 5_000),
        "channels": flat.replace("CHANNELS 1", "CHANNELS 99999999999") % "" + frames_of("0"),
        "name": "ROOT " + "a " * 1_000_000,
        "line": flat % "" + frames_of("0 " * 4_000_000),
    }[kind]
    path = tmp_path / "bad.bvh"
    path.write_text("HIERARCHY\n" + text)
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"bad\.bvh") as raised:
        read_bvh(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 300 * 2**20
    assert len(str(raised.value)) < 400
    path.write_text("HIERARCHY\n" + flat % joints + frames_of("0"))
    with pytest.raises(ValueError, match="it has more than 10000 joints"):
        read_bvh(path)


def test_a_file_cut_anywhere_is_refused_and_never_misread(tmp_path):
    text = HIERARCHY + frames_of(REST, "1 2 3 10 20 30 40 50 60 70 80 9.5")
    path = tmp_path / "cut.bvh"
    # up to the last number's last digits: those cannot be told from a whole file
    for end in range(len(text) - 3):
        path.write_text(text[:end])
        with pytest.raises(ValueError, match=r"cut\.bvh"):
            read_bvh(path)


def test_bytes_that_are_no_text_and_files_that_are_not_there_are_refused(tmp_path):
    path = tmp_path / "noise.bvh"
    path.write_bytes(np.random.default_rng(0).bytes(4000))
    with pytest.raises(ValueError, match="is not a BVH file"):
        read_bvh(path)
    with pytest.raises(FileNotFoundError, match="is not there; give a motion capture file"):
        read_bvh(tmp_path / "absent.bvh")
