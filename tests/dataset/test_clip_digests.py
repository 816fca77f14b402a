"""Hashes of clips: of the bytes alone, read once, and never of what a file was before."""

import hashlib
import os
from pathlib import Path

import pytest

from garment_jax.dataset.clip_digests import NAME, ClipDigests


def test_a_file_is_read_once_and_again_when_it_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path, cache = tmp_path / "a.h5", tmp_path / "cache"
    path.write_bytes(b"waltz")
    expected = hashlib.sha256(b"waltz").hexdigest()
    assert ClipDigests(cache).of(path) == expected
    monkeypatch.setattr(hashlib, "file_digest", lambda *_: pytest.fail("read again"))
    assert ClipDigests(cache).of(path) == expected
    monkeypatch.undo()
    path.write_bytes(b"samba")
    os.utime(path, ns=(1, 1))
    assert ClipDigests(cache).of(path) == hashlib.sha256(b"samba").hexdigest()
    assert [p.name for p in cache.iterdir()] == [NAME]


@pytest.mark.parametrize("damage", [b"", b"{", b"[1]", b'{"x": 3}'])
def test_a_damaged_table_is_made_anew(tmp_path: Path, damage: bytes):
    path = tmp_path / "a.h5"
    path.write_bytes(b"waltz")
    (tmp_path / NAME).write_bytes(damage.replace(b"x", str(path.resolve()).encode()))
    assert ClipDigests(tmp_path).of(path) == hashlib.sha256(b"waltz").hexdigest()
    assert ClipDigests(tmp_path).of(path) == hashlib.sha256(b"waltz").hexdigest()
