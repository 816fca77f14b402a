"""A user's own case from files alone: what cannot be simulated, and how each refusal reads."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from garment_jax.cli import main as garment_jax
from garment_jax.cli import make_parser
from garment_jax.cli.own_scene import own_scene
from tests.animation.tiny_model import SCENE
from tests.reference.files import write_body, write_bvh, write_obj
from tests.reference.scene import make_motion

OWN = ["files", "--garment", "skirt.obj", "--body", "me.npz"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["embedded", "skirt", "--cloth", "bend"], "'bend' needs a number"),
        (["embedded", "skirt", "--frames", "10"], "--frames 10 are too few"),
        (["embedded", "skirt", "--frames", "0"], "--frames 0 are too few"),
        (["embedded", "skirt", "--seed", "-1"], "--seed -1 is too small"),
        (["embedded", "skirt", "--workers", "0"], "--workers 0 is too small"),
        (["embedded", "skirt", "--vertices", "-5"], "--vertices -5 must lie between 100 and"),
        (["embedded", "skirt", "--at-once", "5"], "--at-once is for simulate --device cuda"),
        (["embedded", "skirt", "--device", "cuda:9"], "the device cuda:9 is not there; simulate here on cpu"),
        (["varied", "clips", "--spins", "1e30"], "--spins 1e+30 is too large; give 100 or less"),
        (["varied", "clips", "--copies", "0"], "--copies 0 and --crosses 0 make no clips"),
        ([*OWN, "--motion", "moves", "--skip", "-1"], "--skip -1 is too small"),
        ([*OWN, "--motion", "moves", "--source-fps", "-30"], "--source-fps -30.0 is too small"),
    ],
)
def test_what_cannot_be_simulated_is_refused(tmp_path: Path, words, sentence, capsys):
    assert garment_jax(["simulate", *words, "--out", str(tmp_path / "clips")]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err
    assert not (tmp_path / "clips").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["files", "--garment", "skirt.obj"], "garment-jax simulate files needs --body, --motion; "),
        (["embedded", "skirt", "--pattern", "p.npz"], "has no option --pattern; "),
        (["embedded", "skirt", "--skip", "3"], "has no option --skip; "),
        (["embedded", "skirt", "--turn", "9"], "has no option --turn; "),
        (["embedded", "skirt", "--fit-uv"], "has no option --fit-uv; "),
        (["varied", "clips", "--body", "me.npz"], "has no option --body; "),
        (["varied", "clips", "--pins", "none"], "has no option --pins; "),
        ([*OWN, "--motion", "moves", "--seed", "3"], "has no option --seed; "),
        ([*OWN, "--motion", "moves", "--kicks", "3"], "has no option --kicks; "),
        ([*OWN, "--motion", "moves", "--vertices", "300"], "has no option --vertices; "),
        ([], "garment-jax simulate needs WAY; "),
    ],
)
def test_options_of_another_way_are_refused(tmp_path: Path, words, sentence, capsys):
    with pytest.raises(SystemExit) as end:
        garment_jax(["simulate", *words, *(["--out", str(tmp_path / "clips")] if words else [])])
    assert end.value.code == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "clips").exists()


def body_with(**arrays: np.ndarray) -> Callable[[Path], object]:
    return lambda folder: write_body(folder / "me.npz", SCENE.body._replace(**arrays))


def written(name: str, **arrays: np.ndarray) -> Callable[[Path], object]:
    return lambda folder: np.savez(folder / name, **arrays)


def cut(name: str) -> Callable[[Path], object]:
    def halve(folder: Path) -> None:
        path = folder / name
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return halve


def garment_in_centimetres(folder: Path) -> None:
    garment = SCENE.garment
    write_obj(folder / "skirt.obj", garment._replace(template=garment.template * np.float32(100)))


BODY, PINS = SCENE.body, SCENE.pins
assert PINS is not None
HOLED = np.where(np.arange(len(BODY.vertices))[:, None] == 4, np.nan, BODY.vertices).astype(np.float32)
CASES = {
    "garment in cm": (garment_in_centimetres, [], r"skirt\.obj: the garment is 80 m large"),
    "body in cm": (
        body_with(vertices=BODY.vertices * np.float32(100), joints=BODY.joints * np.float32(100)),
        [],
        r"me\.npz: the body is 13\d m large",
    ),
    "NaN": (body_with(vertices=HOLED), [], r"me\.npz: `vertices` is not finite in row 4"),
    "weights for other joints": (
        body_with(skin_weights=BODY.skin_weights[:, :20]),
        [],
        r"me\.npz: `skin_weights` has shape \(\d+, 20\), but `joints` says j = 22",
    ),
    "weights of 2": (
        body_with(skin_weights=BODY.skin_weights * np.float32(2)),
        [],
        r"me\.npz: a row of `skin_weights` sums to 2",
    ),
    "faces of another mesh": (body_with(faces=BODY.faces + 5_000), [], r"me\.npz: `faces` holds index \d+"),
    "a garment elsewhere": (
        lambda folder: write_obj(
            folder / "skirt.obj",
            SCENE.garment._replace(template=SCENE.garment.template + np.float32([3.0, 0.0, 0.0])),
        ),
        [],
        r"skirt\.obj: the template is \d\.\d\d m from the body; .* in metres and with Y up",
    ),
    "half a body": (cut("me.npz"), [], r"me\.npz is damaged or no \.npz file of plain arrays; copy it again"),
    "half a pattern": (cut("flat.npz"), ["--pattern", "flat.npz"], r"flat\.npz is damaged"),
    "another pattern": (
        written("flat.npz", flat=np.zeros((9, 2))),
        ["--pattern", "flat.npz"],
        r"flat\.npz: the flat pattern has shape \(9, 2\), the garment's UVs",
    ),
    "other pins": (
        written("pins.npz", pins=PINS.vertices + 500, pin_weights=PINS.weights),
        ["--pins", "pins.npz"],
        r"pins\.npz: `pins` holds index 515, outside 0 … 127; .* belong to skirt\.obj",
    ),
    "half a collider": (cut("solid.npz"), ["--collider", "solid.npz"], r"solid\.npz is damaged"),
    "a clip that is a file": (lambda folder: (folder / "clips").write_text(""), [], "clips is no folder"),
}


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_bad_file_is_refused_by_name_before_anything_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys, case: str
):
    pytest.importorskip("newton")
    monkeypatch.setattr("garment_jax.simulation.newton_cloth.drape", no_drape)
    monkeypatch.chdir(tmp_path)
    assert SCENE.collider is not None
    write_body(tmp_path / "me.npz", BODY)
    write_obj(tmp_path / "skirt.obj", SCENE.garment)
    write_bvh(tmp_path / "walk.bvh", BODY, make_motion(SCENE, 6))
    np.savez(tmp_path / "flat.npz", flat=SCENE.garment.uv)
    np.savez(tmp_path / "solid.npz", **SCENE.collider._asdict())
    damage, words, sentence = CASES[case]
    damage(tmp_path)
    own = ["--garment", "skirt.obj", "--body", "me.npz", "--motion", "walk.bvh", "--out", "clips"]
    assert garment_jax(["simulate", "files", *own, *words]) == 2
    error = capsys.readouterr().err
    assert re.search(sentence, error)
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert not list(tmp_path.rglob("*.h5"))


def no_drape(*_, **__):
    raise AssertionError("draped before the input was checked")


def test_a_garment_in_centimetres_with_z_up_is_the_garment(tmp_path: Path) -> None:
    x, y, z = SCENE.garment.template.T
    turned = SCENE.garment._replace(template=100 * np.stack([x, -z, y], axis=-1))
    write_obj(tmp_path / "skirt.obj", turned)
    write_body(tmp_path / "me.npz", BODY)
    files = ["--garment", str(tmp_path / "skirt.obj"), "--body", str(tmp_path / "me.npz"), "--motion", "m"]
    words = ["simulate", "files", *files, "--out", "x", "--garment-unit", "cm", "--garment-up", "Z"]
    scene = own_scene(make_parser().parse_args(words)).scene
    np.testing.assert_allclose(scene.garment.template, SCENE.garment.template, atol=2e-6)
