"""`garment-jax learn`: what it refuses before the work, and a whole tiny run, stopped and gone on with."""

from pathlib import Path

import pytest

from garment_jax.cli import main


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "--garment is not given; name garment and body, or one of skirt, circle_skirt, dress, cape."),
        (["--garment", "a.obj"], "--body is not given; name garment and body, or one of"),
        (["dress", "--body", "me.glb"], "--body is of garments of your own; leave it out, or dress."),
        (["dress", "--test", "jump"], "--test jump is of motions of your own; name them with --motion."),
        (
            ["--garment", "a.obj", "--body", "b.npz", "--vertices", "500"],
            "--vertices is of the package's garments; leave it out.",
        ),
        (["dress", "--minutes", "1"], "--minutes 1 is not between 2 and 100,000; 30 give a usable model."),
        (["dress", "--workers", "0"], "--workers 0 is too small; give 1 or more."),
        (["dress", "--motion", "nothere"], "nothere is not there; name files or folders of motions with"),
        (["--garment", "a.obj", "--body", "b.npz"], "a.obj is not there; name a file with --garment."),
        (["dress", "--minutes", "nan"], "--minutes nan is not between 2 and 100,000"),
        (
            ["dress", "--vertices", "7"],
            "--vertices 7 must lie between 100 and 100000; 900 makes a light one.",
        ),
        (["dress", "--cloth", "bent=1"], "--cloth 'bent=1': there is no setting 'bent'; choose of"),
    ],
)
def test_what_does_not_go_together_is_refused_before_the_work(
    words: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["learn", *words, "--out", str(tmp_path / "model")]) == 2
    assert f"error: {sentence}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_file_in_the_place_of_the_models_folder_is_refused_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "p.h5").write_text("")
    assert main(["learn", "dress", "--out", str(tmp_path / "p.h5")]) == 2
    said = capsys.readouterr()
    assert "p.h5 is a file; a model fills a folder, name a new one." in said.err
    assert said.out == ""
