"""No command carries the bytes of another file of the user's into what it writes."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from garment_jax.cli import main
from tests.io.packed import write_packed
from tests.reference.files import write_body, write_obj
from tests.reference.scene import make_scene, write_clip

SECRET = np.frombuffer(b"for nobody else's eyes: 48 bytes of a private key", "u1")[:48]


def _stored_elsewhere(file: h5py.File, name: str, secret: Path, *, relative: bool) -> None:
    del file[name]
    shape = (6, *([4, 2] if name == "extra/x" else [3]))
    kind = "u1" if name == "extra/x" else "f8"
    place = secret.name if relative else str(secret)
    file.create_dataset(
        name, shape, kind, external=[(place, 0, int(np.prod(shape)) * np.dtype(kind).itemsize)]
    )


@pytest.mark.parametrize("relative", [True, False])
@pytest.mark.parametrize("name", ["extra/x", "root"])
@pytest.mark.parametrize(
    "command",
    [
        ["export", "clip.h5", "--out", "out/a.npz"],
        ["export", "clip.h5", "--out", "out/a.glb"],
        ["collide", "clip.h5", "--out", "out/a.h5"],
        ["validate", "clip.h5", "--fix", "--out", "out"],
        ["view", "clip.h5", "--out", "out/a.html"],
        ["render", "clip.h5", "--out", "out"],
        ["import", "clip.h5", "--garment", "skirt.obj", "--body", "me.npz", "--out", "out"],
    ],
    ids=lambda words: " ".join(words[:1] + words[-1:]),
)
def test_external_storage_is_in_no_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys, command: list[str], name: str, relative: bool
):
    monkeypatch.chdir(tmp_path)
    secret = tmp_path / "secret"
    secret.write_bytes(SECRET.tobytes() * 4)
    clip = write_clip(tmp_path / "clip.h5", 6)
    write_obj(tmp_path / "skirt.obj", make_scene().garment)
    write_body(tmp_path / "me.npz", make_scene().body)
    with h5py.File(clip, "r+") as file:
        file["extra/x"] = np.zeros(6)
        _stored_elsewhere(file, name, secret, relative=relative)
    assert main(command) in (1, 2)
    said = capsys.readouterr()
    assert f"dataset '{name}' is stored in another file, which is not read" in said.out + said.err
    written = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert written == []


@pytest.mark.parametrize("named", ["../../elsewhere/body.npz", "/elsewhere/body.npz"])
def test_a_packed_clip_names_no_body_elsewhere(tmp_path: Path, capsys, named: str):
    clip = write_packed(tmp_path, "train_waltz", 3)
    with h5py.File(clip, "r+") as file:
        file.attrs["body"] = named
    assert main(["import", str(clip), "--out", str(tmp_path / "out")]) == 2
    assert f"names its body '{named}', elsewhere; name it with --body FILE.npz" in capsys.readouterr().err
    body = str(tmp_path / "avatar" / "avatar.npz")
    assert main(["import", str(clip), "--out", str(tmp_path / "out"), "--body", body]) == 0
