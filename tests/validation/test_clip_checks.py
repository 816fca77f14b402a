"""A good clip has no finding; broken in one way it has that finding, and no other."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.importers.finding import Finding
from garment_jax.validation.clip_checks import check_clip
from garment_jax.validation.raw_clip import RawClip
from garment_jax.validation.vertex_scan import WINDOW
from tests.validation.broken_clips import (
    FRAMES,
    LENGTHS,
    broken,
    edit,
    frozen_end,
    good_clip,
    held,
    other_motion,
    put,
    rest_pose_first,
    scaled,
    set_attribute,
    turned,
)

EXPECTED_NOTES = {"joints without weight"}  # the reference body has no arms
HEM = 120  # a vertex at the skirt's lower end


def check_sequence(path: Path) -> list[Finding]:
    with RawClip(path) as clip:
        return check_clip(clip)


def told(findings: list[Finding]) -> list[Finding]:
    """What a user would read, without the notes that every clip of this body has."""
    return [f for f in findings if f.severity != "ok" and f.check not in EXPECTED_NOTES]


@pytest.mark.parametrize("encoding", ["float32", "int16"])
def test_a_good_clip_has_no_finding(tmp_path: Path, encoding: str):
    assert told(check_sequence(good_clip(tmp_path / "good.h5", encoding=encoding))) == []


def test_a_motion_alone_is_checked_without_its_cloth(tmp_path: Path):
    from garment_jax.io.sequence_writer import SequenceWriter
    from tests.validation.broken_clips import calm_motion, calm_scene

    with SequenceWriter(tmp_path / "m.h5", calm_scene(), calm_motion(), encoding="none"):
        pass
    assert told(check_sequence(tmp_path / "m.h5")) == []


def at(frame: int, vertex: int, value: object) -> Callable[[np.ndarray], None]:
    """Return the change of one vertex in one frame."""

    def change(V: np.ndarray) -> None:
        V[frame, vertex] = value

    return change


def moved(frame: int, vertex: int, by: float) -> Callable[[np.ndarray], None]:
    """Return the change that moves a vertex from a frame on."""

    def change(V: np.ndarray) -> None:
        V[frame:, vertex, 1] += by

    return change


def shuffled(V: np.ndarray) -> np.ndarray:
    return V[:, np.random.default_rng(0).permutation(V.shape[1])]


def stretched(file: h5py.File) -> None:
    """Pull the lower half of the skirt down, more and more."""
    V, T = file["vertices"][()], file["template"][()]
    depth = np.maximum(T[:, 1].max() - T[:, 1] - 0.1, 0)
    V[:, :, 1] -= 0.9 * depth * np.linspace(0, 1, len(V))[:, None]
    put(file, "vertices", V)


def frozen_cloth(file: h5py.File) -> None:
    V = file["vertices"][()]
    V[40:47] = V[40]
    put(file, "vertices", V)


def sunk(file: h5py.File) -> None:
    """Shrink the skirt into the body, the template too: it is cloth, but inside."""
    del file["pins"]
    for name, centre in (("template", None), ("vertices", file["root"][()][:, None])):
        values = file[name][()].astype(np.float64)
        middle = np.array([0.0, 0.83, 0.0]) if centre is None else centre
        values[..., [0, 2]] = (values - middle)[..., [0, 2]] * 0.1 + np.broadcast_to(middle, values.shape)[
            ..., [0, 2]
        ]
        put(file, name, values.astype(np.float32))


def body_jump(file: h5py.File) -> None:
    root, V = file["root"][()], file["vertices"][()]
    root[50:, 0] += 1.5
    V[50:, :, 0] += np.float32(1.5)
    put(file, "root", root)
    put(file, "vertices", V)


def still(file: h5py.File) -> None:
    for name in ("rotations", "root", "vertices"):
        values = file[name][()]
        values[:] = values[:1]
        put(file, name, values)


def shorter(name: str) -> Callable[[h5py.File], None]:
    return edit(name, lambda values: values[:-2])


def fewer(file: h5py.File) -> None:
    put(file, "vertices", file["vertices"][()][:, :-1])


def inside_out(file: h5py.File) -> None:
    put(file, "body/faces", file["body/faces"][()][:, ::-1])


def far_away(file: h5py.File) -> None:
    put(file, "template", file["template"][()] + np.float32([3, 0, 0]))


def too_far(file: h5py.File) -> None:
    """The frames of a clip at another place of the world; without pins, which would be told too."""
    del file["pins"]
    put(file, "vertices", file["vertices"][()] + np.float32([3, 0, 0]))


def halved(weights: np.ndarray) -> None:
    weights[7] *= 0.5


CASES: dict[str, tuple[Callable[[h5py.File], object], str, str, str]] = {
    "NaN": (edit("vertices", at(70, HEM, np.nan)), "NaN", "error", "frame 70, vertex 120"),
    "centimetres": (scaled(*LENGTHS, factor=100), "body unit", "error", "136 large, which looks like cm"),
    "millimetres": (scaled(*LENGTHS, factor=1000), "body unit", "error", "looks like mm"),
    "cloth in cm": (scaled("vertices", factor=100), "frames unit", "error", "edges are 100"),
    "motion in cm": (scaled("root", factor=100), "root unit", "error", "the root is 83"),
    "template in mm": (scaled("template", factor=0.02), "garment unit", "error", "is 0.016 m large"),
    "unit missing": (set_attribute("length_unit", None), "body unit", "error", "length_unit is None"),
    "Z up": (turned(canonical=True, world=True), "up axis", "error", "body and motion stand along Z"),
    "motion Z up": (turned(canonical=False, world=True), "up axis", "error", "the motion stands along Z"),
    "motion -Z up": (
        turned(canonical=False, world=True, back=True),
        "up axis",
        "error",
        "the motion stands along -Z",
    ),
    "body Z up": (turned(canonical=True, world=False), "up axis", "error", "the body stands along Z"),
    "said to be Z": (set_attribute("up_axis", "Z"), "up axis", "error", "body and motion stand along Y"),
    "no rate": (set_attribute("fps", None), "frame rate", "error", "fps is missing"),
    "rate as text": (set_attribute("fps", "30 fps"), "frame rate", "error", "fps is '30 fps'"),
    "rate of 240": (set_attribute("fps", 240.0), "fps", "warning", "likely wrong"),
    "rate of 0.5": (set_attribute("fps", 0.5), "fps", "note", "slow"),
    "held poses": (held, "repeated frames", "warning", "the true rate is 7.5"),
    "static": (still, "static", "error", "no joint moves"),
    "frozen end": (frozen_end, "frozen end", "warning", "last 30 frames"),
    "cloth frozen": (frozen_cloth, "cloth frozen", "warning", "for 6 frames"),
    "rest pose": (rest_pose_first, "rest pose", "warning", "a rest pose, a jump"),
    "body jumps": (body_jump, "jumps", "error", "frame 49 to 50"),
    "a vertex jumps": (
        edit("vertices", moved(60, HEM, 0.8)),
        "cloth jumps",
        "error",
        "frame 59 to 60, vertex 120",
    ),
    "other order": (edit("vertices", shuffled), "vertex order", "error", "vertices"),
    "strain": (stretched, "strain", "warning", "cloth stretches to 25"),
    "other clip's cloth": (other_motion, "pins", "error", "vertex"),
    "frames fewer": (shorter("vertices"), "frame count", "error", "`root` 90"),
    "root fewer": (shorter("root"), "frame count", "error", "`root` 88"),
    "vertices fewer": (fewer, "vertex count", "error", "127 vertices, the template has 128"),
    "weights": (edit("body/skin_weights", halved), "skin weights", "error", "vertex 7"),
    "pin weights": (edit("pins/weights", halved), "pin weights", "error", "vertex 7"),
    "body inside out": (inside_out, "body surface", "error", "look inwards"),
    "not on the body": (far_away, "template on body", "error", "from the body"),
    "another place": (too_far, "garment on body", "error", "frame 0"),
    "inside the body": (sunk, "garment in body", "error", "are inside"),
    "UVs in metres": (scaled("uv", factor=3), "UV range", "error", "from 0 to 3"),
    "no rotations": (scaled("rotations", factor=1.5), "rotations", "error", "frame 0, joint Hips"),
}


@pytest.mark.parametrize("case", CASES)
def test_one_fault_is_one_finding(tmp_path: Path, case: str):
    change, check, severity, words = CASES[case]
    path = broken(tmp_path / "clip.h5", change)
    found = told(check_sequence(path))
    assert [f.check for f in found] == [check], found
    with RawClip(path) as clip:  # what `import` looks at has all that it refuses
        assert [f for f in check_clip(clip, warn=False) if f.severity == "error"] == [
            f for f in found if f.severity == "error"
        ]
    assert found[0].severity == severity
    assert words in f"{found[0].value} {found[0].where}"
    assert found[0].remedy


@pytest.mark.parametrize("case", ["strain"])
def test_a_networks_frame_is_not_told_to_be_simulated_again(tmp_path: Path, case: str):
    def predicted(file: h5py.File) -> None:
        CASES[case][0](file)
        file.attrs["kind"] = "predicted"

    (found,) = told(check_sequence(broken(tmp_path / "clip.h5", predicted)))
    assert found.remedy == "a network's frame: look at it in garment-jax view"


def test_windows_do_not_change_what_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert WINDOW < FRAMES
    path = broken(tmp_path / "clip.h5", edit("vertices", moved(WINDOW, HEM, 0.8)))
    by_windows = check_sequence(path)
    monkeypatch.setattr("garment_jax.validation.vertex_scan.WINDOW", 1_000)
    assert check_sequence(path) == by_windows
    assert any(f.where.startswith(f"frame {WINDOW - 1} to {WINDOW}") for f in by_windows)


@pytest.mark.parametrize("case", ["centimetres", "Z up", "motion Z up", "body Z up", "cloth in cm"])
def test_a_repair_gives_the_clip_back(tmp_path: Path, case: str):
    with RawClip(good_clip(tmp_path / "good.h5")) as good:
        expected, scene, motion = good.read(0, FRAMES), good.scene, good.motion
    with RawClip(broken(tmp_path / "clip.h5", CASES[case][0])) as clip:
        check_clip(clip)
        np.testing.assert_allclose(clip.read(0, FRAMES), expected, atol=2e-6)
        np.testing.assert_allclose(clip.scene.body.joints, scene.body.joints, atol=1e-6)
        np.testing.assert_allclose(clip.motion.rotations, motion.rotations, atol=1e-6)
        np.testing.assert_allclose(clip.motion.root, motion.root, atol=1e-6)
