"""What a sequence file may be written to: never a folder or another format."""

from pathlib import Path

import pytest

from garment_jax.io.overwrite_checks import check_sequence_name


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        (".", r"^\. is a folder; name a sequence file"),
        ("..", r"^\.\. is a folder; name a sequence file"),
        ("folder", r"--out folder is a folder; name a sequence file"),
        ("garment.obj", r"does not end in \.h5; name a sequence file, such as garment\.obj\.h5"),
        (f"{'a' * 300}.h5", r"^a{24}… is a name of 303 bytes, more than 255; give a shorter one"),
        (f"{'ä' * 127}.h5", r"is a name of 257 bytes, more than 255"),
        (f"{'b' * 300}/a.h5", r"^b{24}… is a name of 300 bytes, more than 255"),
    ],
)
def test_what_must_not_be_written_to_is_refused(tmp_path: Path, monkeypatch, out, sentence):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with pytest.raises(ValueError, match=sentence):
        check_sequence_name(Path(out))


def test_new_names_may_be_written(tmp_path: Path):
    for path in (tmp_path / "not" / "there" / "yet.h5", tmp_path / f"{'a' * 237}.h5"):
        check_sequence_name(path)
