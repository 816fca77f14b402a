"""Checkpoints come back bit for bit, survive what interrupts them, and refuse what does not fit."""

import errno
import json
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from garment_jax.config import TrainingConfig
from garment_jax.storage.scratch import make_scratch
from garment_jax.training import checkpoint
from garment_jax.training.checkpoint import Checkpointer
from garment_jax.training.optimiser import make_schedule


def state() -> dict[str, Any]:
    return {
        "params": {
            "w": jax.random.normal(jax.random.key(0), (4, 3)),
            "b": jnp.full(2, 1 / 3, jnp.bfloat16),
        },
        "host": np.arange(3, dtype=np.int64),
        "count": jnp.asarray(5, jnp.int32),
        "flag": jnp.asarray([True, False]),
        "typed": jax.random.split(jax.random.key(1, impl="rbg"), 2),
        "legacy": jax.random.PRNGKey(2),
        "empty": jnp.zeros((0, 3)),
        "nothing": None,
        "step": 7,
        "rate": 0.1,
        "on": True,
    }


def assert_same_bits(a: Any, b: Any) -> None:
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert type(x) is type(y)
        if isinstance(x, jax.Array) and jnp.issubdtype(x.dtype, jax.dtypes.prng_key):
            assert x.dtype == y.dtype
            x, y = jax.random.key_data(x), jax.random.key_data(y)
        assert np.asarray(x).dtype == np.asarray(y).dtype
        assert np.asarray(x).tobytes() == np.asarray(y).tobytes()


def test_every_kind_of_leaf_comes_back_bit_for_bit(tmp_path: Path) -> None:
    saver = Checkpointer(tmp_path, "stage", metadata={"config": {"a": 1}})
    saver.save(3, state(), extra={"seconds": 2.5})
    other = Checkpointer(tmp_path, "stage")
    assert_same_bits(other.restore(state()), state())
    described = other.metadata()
    assert (described["step"], described["metadata"], described["extra"]) == (
        3,
        {"config": {"a": 1}},
        {"seconds": 2.5},
    )
    assert described["versions"]["jax"] == jax.__version__


def test_shapes_alone_are_enough_to_restore_a_part(tmp_path: Path) -> None:
    Checkpointer(tmp_path, "stage").save(1, state())
    shapes = jax.eval_shape(lambda: state()["params"])
    assert_same_bits(Checkpointer(tmp_path, "stage").restore({"params": shapes})["params"], state()["params"])


def test_the_newest_two_are_kept(tmp_path: Path) -> None:
    saver = Checkpointer(tmp_path, "stage")
    assert saver.latest() is None
    for step in (1, 2, 10):
        saver.save(step, {"x": jnp.asarray(float(step))})
    assert saver.steps() == [2, 10]
    assert float(saver.restore({"x": jnp.zeros(())}, step=2)["x"]) == 2.0


def test_a_save_that_was_killed_is_not_seen_and_removed(tmp_path: Path) -> None:
    saver = Checkpointer(tmp_path, "stage")
    saver.save(1, {"x": jnp.zeros(2)})
    dead = make_scratch(saver.folder)
    living = make_scratch(saver.folder)
    dead = dead.rename(dead.with_name(dead.name.replace(str(os.getpid()), str(2**22 + 1))))  # nobody's number
    shutil.copytree(saver.folder / "1", dead / "2")
    assert saver.latest() == 1
    reader = Checkpointer(tmp_path, "stage")
    assert reader.steps() == [1]
    assert dead.is_dir()  # reading removes nothing
    reader.save(3, {"x": jnp.zeros(2)})
    assert sorted(path.name for path in saver.folder.iterdir()) == sorted([living.name, "1", "3"])


def test_looking_for_checkpoints_makes_no_folder(tmp_path: Path) -> None:
    assert Checkpointer(tmp_path, "stage").latest() is None
    assert list(tmp_path.iterdir()) == []


def test_a_checkpoint_appears_by_one_rename_only(tmp_path: Path, monkeypatch: Any) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    saver = Checkpointer(tmp_path, "stage")
    monkeypatch.setattr(checkpoint.os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        saver.save(1, {"x": jnp.zeros(2)})
    assert list(saver.folder.iterdir()) == []


def test_nothing_is_printed_and_no_thread_stays(tmp_path: Path, capfd: Any) -> None:
    tree = {f"w{i}": np.random.default_rng(i).normal(size=(512, 512)).astype(np.float32) for i in range(30)}
    before = threading.active_count()
    saver = Checkpointer(tmp_path, "stage")
    saver.save(1, tree)
    saver.restore(tree)
    assert threading.active_count() <= before
    assert capfd.readouterr() == ("", "")


def test_a_full_disk_is_one_sentence_and_leaves_the_last_one(tmp_path: Path, monkeypatch: Any) -> None:
    saver = Checkpointer(tmp_path, "stage")
    saver.save(1, {"x": jnp.zeros(2)})
    write = checkpoint._write

    def fill(partial: Path, *rest: Any) -> None:
        write(partial, *rest)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(checkpoint, "_write", fill)
    with pytest.raises(OSError, match=r"The disk is full, so .*stage/2 was not saved; free space"):
        saver.save(2, {"x": jnp.ones(2)})
    assert [path.name for path in saver.folder.iterdir()] == ["1"]


@pytest.fixture
def small_disk(tmp_path: Path) -> Any:
    """A file system of 2 MB, where the machine lets us mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)]
    if sys.platform != "linux" or subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small file system needs Linux and root")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_disk_that_is_really_full(small_disk: Path) -> None:
    saver = Checkpointer(small_disk, "stage")
    saver.save(1, {"x": jnp.zeros(2)})
    noise = np.random.default_rng(0).integers(0, 2**31, size=(1024, 1024)).astype(np.int32)
    with pytest.raises(OSError, match="The disk is full"):
        saver.save(2, {"x": noise})
    assert saver.steps() == [1]
    assert_same_bits(saver.restore({"x": jnp.ones(2)}), {"x": jnp.zeros(2)})


def test_values_that_are_not_finite_are_not_saved(tmp_path: Path) -> None:
    saver = Checkpointer(tmp_path, "stage")
    with pytest.raises(ValueError, match=r"params/w holds NaN or infinite values at step 4"):
        saver.save(4, {"params": {"w": jnp.asarray([1.0, jnp.nan])}})
    assert saver.steps() == []


@pytest.mark.parametrize(
    ("like", "message"),
    [
        ({"x": jnp.zeros(3)}, r"x has shape \[2\], not \[3\]"),
        ({"x": jnp.zeros(2, jnp.int32)}, "x has dtype float32, not int32"),
        ({"x": 1.0}, "x has kind array, not number"),
        ({"y": jnp.zeros(2)}, "holds no 'y'"),
    ],
)
def test_another_networks_state_is_refused(tmp_path: Path, like: Any, message: str) -> None:
    saver = Checkpointer(tmp_path, "stage")
    saver.save(1, {"x": jnp.zeros(2)})
    with pytest.raises(ValueError, match=message):
        saver.restore(like)


def test_a_schedule_that_older_versions_had_in_their_program_is_that_of_the_configuration(tmp_path: Path):
    params = {"w": jnp.ones(3)}
    before = optax.scale_by_schedule(lambda count: 0.1).init(params)._replace(count=jnp.int32(7))
    Checkpointer(tmp_path, "stage").save(7, {"opt_state": (before,)})
    now = make_schedule(TrainingConfig(), learning_rate=0.3, steps=50)
    (found,) = Checkpointer(tmp_path, "stage").restore({"opt_state": (now,)})["opt_state"]
    assert_same_bits(found, now._replace(count=jnp.int32(7)))


def test_missing_and_damaged_checkpoints_say_what_to_do(tmp_path: Path) -> None:
    saver = Checkpointer(tmp_path, "stage")
    with pytest.raises(FileNotFoundError, match=r"No checkpoint in .*stage; train this stage first"):
        saver.restore({"x": jnp.zeros(2)})
    path = saver.save(1, {"x": jnp.zeros(2)})
    shutil.rmtree(path / "state")
    sentence = r"stage/1 is damaged \(state/.* is not as it was saved\), and none before it is left; delete"
    with pytest.raises(ValueError, match=sentence):
        Checkpointer(tmp_path, "stage").restore({"x": jnp.zeros(2)})
    (path / "digests.json").unlink()  # as older versions wrote it
    with pytest.raises(ValueError, match=r"stage/1 cannot be read; delete it"):
        Checkpointer(tmp_path, "stage").restore({"x": jnp.zeros(2)})


@pytest.mark.parametrize("seed", range(20))
def test_a_flipped_bit_anywhere_is_seen_and_the_checkpoint_before_is_taken(
    tmp_path: Path, seed: int, capsys: Any
) -> None:
    saver = Checkpointer(tmp_path, "stage")
    for step in (1, 2):
        saver.save(step, {"x": jnp.full(500, float(step))})
    rng = np.random.default_rng(seed)
    files = sorted(p for p in (saver.folder / "2").rglob("*") if p.is_file() and p.stat().st_size)
    path = files[rng.integers(len(files))]
    content = bytearray(path.read_bytes())
    content[rng.integers(len(content))] ^= 1 << rng.integers(8)
    path.write_bytes(content)
    reader = Checkpointer(tmp_path, "stage")
    assert float(reader.restore({"x": jnp.zeros(500)})["x"][0]) == 1.0
    assert reader.latest() == 1
    assert capsys.readouterr().err.startswith(f"{saver.folder}/2 is damaged (")
    reader.save(2, {"x": jnp.full(500, 2.0)})  # what is damaged is made anew
    assert float(Checkpointer(tmp_path, "stage").restore({"x": jnp.zeros(500)})["x"][0]) == 2.0


@pytest.mark.parametrize("text", ["", "[]", "null", '{"leaves": 3}'])
def test_a_description_that_is_none_is_refused_with_the_remedy(tmp_path: Path, text: str) -> None:
    saver = Checkpointer(tmp_path, "stage")
    path = saver.save(3, state())
    (path / "metadata.json").write_text(text)
    (path / "digests.json").unlink()  # as older versions wrote it
    saver = Checkpointer(tmp_path, "stage")
    for read in (saver.metadata, lambda: saver.tree("params"), lambda: saver.restore(state())):
        with pytest.raises(ValueError, match=r"stage/3 cannot be read; delete it to go on"):
            read()


def test_a_disk_without_room_is_one_sentence_and_no_thread_speaks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    if not hasattr(os, "posix_fallocate"):
        pytest.skip("no way to ask for room here")
    saver = Checkpointer(tmp_path, "stage")
    saver.save(1, {"x": jnp.zeros(2)})

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match=r"^The disk is full, so .*stage/2 was not saved; free space, then run"):
        saver.save(2, {"x": jnp.ones(2)})
    assert capfd.readouterr() == ("", "")
    assert [path.name for path in saver.folder.iterdir()] == ["1"]


@pytest.mark.parametrize(
    "change",
    [
        lambda described: described.pop("metadata"),
        lambda described: described.update(extra=[]),
        lambda described: described["leaves"][0].update(path=3),
        lambda described: described["leaves"][0].update(path=described["leaves"][1]["path"]),
        lambda described: described["leaves"][1].update(path=described["leaves"][0]["path"] + "/x"),
        lambda described: described["leaves"][0].update(shape=[7]),
    ],
)
def test_a_description_without_digests_that_is_not_of_the_arrays_is_refused(tmp_path: Path, change: Any):
    saved = Checkpointer(tmp_path, "stage")
    saved.save(3, {"params": {"a": np.ones(2), "b": np.zeros(2)}})
    (saved.folder / "3/digests.json").unlink()  # as older versions saved
    described = json.loads((saved.folder / "3/metadata.json").read_text())
    change(described)
    (saved.folder / "3/metadata.json").write_text(json.dumps(described))
    with pytest.raises(ValueError, match=r"stage/3 cannot be read; delete it to go on"):
        Checkpointer(tmp_path, "stage").tree("params")
