"""Bodies, colliders and pins from `.npz` files: a test for every refusal, by file and array."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from garment_jax.io.npz import load_body, load_collider, load_pin_file, read_arrays
from garment_jax.structs import Pins, RiggedBody
from tests.reference.files import write_body
from tests.reference.scene import make_scene

SCENE = make_scene()
assert SCENE.pins is not None
assert SCENE.collider is not None


def body_arrays() -> dict[str, np.ndarray]:
    return {key: np.array(value) for key, value in SCENE.body._asdict().items()}


def write_pins(path: Path, pins: Pins) -> Path:
    np.savez(path, pins=pins.vertices, pin_weights=pins.weights)
    return path


def poke(name: str, index: object, value: float) -> Callable[[dict], None]:
    return lambda arrays: arrays[name].__setitem__(index, value)


def change(name: str, new: Callable[[np.ndarray], object]) -> Callable[[dict], None]:
    return lambda arrays: arrays.update({name: new(arrays[name])})


def test_a_body_comes_back_in_the_types_of_its_structure(tmp_path: Path):
    wide = {key: value.astype("i8") for key, value in body_arrays().items() if value.dtype.kind == "i"}
    wide |= {key: value.astype("f8") for key, value in body_arrays().items() if value.dtype.kind == "f"}
    np.savez(tmp_path / "me.npz", **(body_arrays() | wide))
    body = load_body(tmp_path / "me.npz")
    for key in RiggedBody._fields:
        expected, found = np.array(getattr(SCENE.body, key)), np.array(getattr(body, key))
        np.testing.assert_array_equal(found, expected)
        assert found.dtype == expected.dtype


BODIES = {
    "vertices not finite": (poke("vertices", (7, 1), np.nan), "`vertices` is not finite in row 7; export"),
    "joints not finite": (poke("joints", (2, 0), np.inf), "`joints` is not finite in row 2"),
    "weights not finite": (poke("skin_weights", (5, 3), np.nan), "`skin_weights` is not finite in row 5"),
    "a joint too many in the weights": (
        change("skin_weights", lambda W: np.pad(W, ((0, 0), (0, 2)))),
        r"`skin_weights` has shape \(\d+, 24\), but `joints` says j = 22; write both",
    ),
    "weights of other vertices": (
        change("skin_weights", lambda W: W[:-1]),
        r"`skin_weights` has shape \(\d+, 22\), but `vertices` says b = \d+",
    ),
    "weights of 0.5": (change("skin_weights", lambda W: W / 2), "a row of `skin_weights` sums to 0.5; norm"),
    "a vertex that is not there": (poke("faces", (3, 1), 99_999), r"`faces` holds index 99999, outside 0 …"),
    "a negative vertex": (poke("faces", (3, 1), -2), "`faces` holds index -2, outside 0"),
    "quads": (
        change("faces", lambda f: np.pad(f, ((0, 0), (0, 1)))),
        r"`faces` has shape \(\d+, 4\), expected \[g, 3\]",
    ),
    "indices of no type": (change("faces", lambda f: f + 0.5), "`faces` has type float64; store whole num"),
    "text for numbers": (change("joints", lambda x: x.astype("U8")), "`joints` has type <U8; store numbers"),
    "bytes for text": (
        change("joint_names", lambda n: n.astype("S16")),
        r"`joint_names` has type \|S16; store text",
    ),
    "one name": (change("joint_names", lambda n: n[0]), r"`joint_names` has shape \(\), expected \[j\]"),
    "parents in disorder": (poke("parents", 3, 9), r"`parents` is \[.*\]; joint 0 must be the root"),
    "no vertices": (
        lambda arrays: arrays.update(vertices=np.zeros((0, 3)), skin_weights=np.zeros((0, 22))),
        "there are 0 body vertices",
    ),
    "no weights": (lambda arrays: arrays.pop("skin_weights"), "array 'skin_weights' is missing; it needs"),
}


@pytest.mark.parametrize("case", BODIES, ids=str)
def test_a_body_that_does_not_fit_is_refused_by_file_and_array(tmp_path: Path, case: str):
    damage, sentence = BODIES[case]
    arrays = body_arrays()
    damage(arrays)
    np.savez(tmp_path / "me.npz", **arrays)
    with pytest.raises(ValueError, match=r"^\S*me\.npz: " + sentence) as refusal:
        load_body(tmp_path / "me.npz")
    assert "\n" not in str(refusal.value)


KNOWN = {"n": (128, "skirt.obj"), "b": (len(SCENE.body.vertices), "me.npz"), "j": (22, "me.npz")}
PINS = {
    "another garment's": (
        lambda pins: pins._replace(vertices=pins.vertices + 120),
        "`pins` holds index 135, outside 0 … 127; indices count from 0 and belong to skirt.obj",
    ),
    "from the end": (lambda p: p._replace(vertices=p.vertices - 1), "`pins` holds index -1, outside 0"),
    "another body's": (
        lambda pins: pins._replace(weights=pins.weights[:, :20]),
        r"`pin_weights` has shape \(16, 20\), but `me.npz` says j = 22; write",
    ),
    "fewer weights": (
        lambda pins: pins._replace(weights=pins.weights[:5]),
        r"`pin_weights` has shape \(5, 22\), but `pins` says p = 16",
    ),
    "weights of 2": (lambda p: p._replace(weights=p.weights * 2), "a row of `pin_weights` sums to 2"),
    "weights not finite": (lambda p: p._replace(weights=p.weights * np.nan), "`pin_weights` is not finite"),
}


@pytest.mark.parametrize("case", PINS, ids=str)
def test_pins_that_do_not_fit_garment_and_body_are_refused(tmp_path: Path, case: str):
    damage, sentence = PINS[case]
    assert SCENE.pins is not None
    path = write_pins(tmp_path / "pins.npz", damage(SCENE.pins))
    with pytest.raises(ValueError, match=r"^\S*pins\.npz: " + sentence):
        load_pin_file(path, KNOWN)


def test_sound_pins_come_back_with_and_without_what_they_belong_to(tmp_path: Path):
    assert SCENE.pins is not None
    path = write_pins(tmp_path / "pins.npz", SCENE.pins)
    for pins in (load_pin_file(path), load_pin_file(path, KNOWN)):
        np.testing.assert_array_equal(pins.vertices, SCENE.pins.vertices)
        np.testing.assert_array_equal(pins.weights, SCENE.pins.weights)


@pytest.mark.parametrize(
    ("array", "sentence"),
    [
        ("body_vertices", r"`body_vertices` holds index \d+, outside 0 … \d+; .* belong to me\.npz"),
        ("cap_loop", r"`cap_loop` holds index \d+, outside 0"),
        ("faces", r"`faces` holds index \d+, outside 0"),
    ],
)
def test_a_collider_of_another_body_is_refused(tmp_path: Path, array: str, sentence: str):
    assert SCENE.collider is not None
    arrays = SCENE.collider._asdict()
    cap = np.array([0, 1], np.int32)
    np.savez(tmp_path / "solid.npz", **(arrays | {"cap_loop": cap}))
    assert len(load_collider(tmp_path / "solid.npz", KNOWN).cap_loop) == 2
    wrong = (cap if array == "cap_loop" else arrays[array]) + 1_000
    np.savez(tmp_path / "solid.npz", **(arrays | {"cap_loop": cap, array: wrong}))
    with pytest.raises(ValueError, match=r"^\S*solid\.npz: " + sentence):
        load_collider(tmp_path / "solid.npz", KNOWN)


def test_an_empty_list_of_a_cap_is_no_cap(tmp_path: Path):
    """`np.savez(cap_loop=[])` stores 64-bit floats, none of them."""
    assert SCENE.collider is not None
    own = len(SCENE.collider.body_vertices)
    faces = SCENE.collider.faces[(SCENE.collider.faces < own).all(axis=1)]
    np.savez(tmp_path / "solid.npz", **(SCENE.collider._asdict() | {"cap_loop": [], "faces": faces}))
    assert load_collider(tmp_path / "solid.npz", KNOWN).cap_loop.dtype == np.int32


def half(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def corrupt(path: Path) -> None:
    """Damage the middle, so that the directory at the end is still there."""
    with np.load(path) as file:
        np.savez_compressed(path, **dict(file))
    content = bytearray(path.read_bytes())
    content[64:] = content[64:1_000].translate(bytes(range(255, -1, -1))) + content[1_000:]
    path.write_bytes(content)


def one_array(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.arange(3))


def text(path: Path) -> None:
    path.write_text("no archive")


def nothing(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize("damage", [half, corrupt, one_array, text, nothing])
def test_a_damaged_file_is_refused_in_a_sentence(tmp_path: Path, damage: Callable[[Path], None]):
    path = write_body(tmp_path / "me.npz", SCENE.body)
    damage(path)
    with pytest.raises(OSError, match=r"me\.npz is damaged or no \.npz file of plain arrays") as refusal:
        load_body(path)
    assert "\n" not in str(refusal.value)


def test_pickled_objects_are_refused_by_array(tmp_path: Path):
    np.savez(tmp_path / "me.npz", **(body_arrays() | {"joint_names": np.array(["a", None], object)}))
    sentence = r"me\.npz: array 'joint_names' holds pickled Python objects, which are not read; store"
    with pytest.raises(ValueError, match=sentence):
        load_body(tmp_path / "me.npz")


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path):
    for path, what in ((tmp_path / "no.npz", "is not there"), (tmp_path, "is a folder")):
        with pytest.raises(OSError, match=rf"{what}; name an \.npz file"):
            read_arrays(path, ("flat",))
