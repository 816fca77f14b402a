"""Every command that writes files, what it reads, and what it has made."""

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.fuzz.command_lines import in_a_fork

_KNOWN: dict[bytes, bytes] = {}  # digests of checkpoints' arrays, by those of their files


class Command(NamedTuple):
    """A command line, run in a folder that holds what it reads."""

    words: tuple[str, ...]
    makes: tuple[str, ...]  # files and folders, compared afterwards
    arrays: bool = False  # a time or a path in what it writes differs from run to run: arrays are compared
    before: str = ""  # a command that makes what it reads


def commands() -> dict[str, Command]:
    """Return the commands by name."""
    model, clip, body = "model", "clips/test/polka.h5", ("--body", "body.npz", "--garment", "cloth.obj")
    exports = {"npz": "npz", "pc2": "pc2", "mdd": "mdd", "glb": "glb", "obj": "frames", "usd": "usda"}
    train = ("train.py", "tiny.toml", "--data", "clips", "--run-dir", "run")
    found = {
        "save": Command(("save", model, "--out", "out", "--bits", "32"), ("out",)),
        "evaluate": Command(("evaluate", clip, clip, "--out", "figures.json"), ("figures.json",)),
        "render": Command(("render", clip, "--out", "sheet", "--frames", "2", "--height", "80"), ("sheet",)),
        "view": Command(("view", clip, "--out", "page.html"), ("page.html",)),
        "collide": Command(("collide", clip, "--out", "out/solved.h5"), ("out",), arrays=True),
        "import": Command(("import", "walk.bvh", *body, "--out", "got"), ("got",)),
        "validate": Command(("validate", "scaled.npz", "--fix", "--out", "fixed"), ("fixed",)),
        "infer": Command(
            ("infer.py", model, "--motion", clip, "--out", "pred.h5"), ("pred.h5",), arrays=True
        ),
        "infer run": Command(
            ("infer.py", "run", "--motion", clip, "--out", "of_run.h5"), ("of_run.h5",), True, before="train"
        ),
        "animate": Command(("animate", model, clip, "--out", "moved.npz"), ("moved.npz",), arrays=True),
        "import clips": Command(("import", "walk.bvh", *body, "--out", "clips"), ("clips",)),
        "train generative": Command((*train, "--stage", "generative"), ("run",), arrays=True),
        "train": Command(train, ("run",), arrays=True),
        "simulate": Command(
            ("simulate", "files", *body, "--motion", "walk.bvh", "--out", "made"), ("made",), arrays=True
        ),
        "floor": Command(
            ("floor", clip, "--start", "2", "--frames", "2", "--out", "again.h5"), ("again.h5",), arrays=True
        ),
        "benchmark": Command(
            ("benchmark", "bench.toml", "--data", "clips", "--out", "bench", "--report-only"), ("bench",)
        ),
        "stability": Command(
            ("stability", model, "--clips", "clips/test", "--only", "skinning", "--out", "stable"),
            ("stable",),
        ),
        "export onnx": Command(
            ("export", model, "--format", "onnx", "--clip", clip, "--out", "out/step.onnx"), ("out",)
        ),
    }
    for kind, name in exports.items():
        out = name if kind == "obj" else f"out/walk.{name}"
        words = ("export", clip, "--out", out, *(("--format", "obj") if kind == "obj" else ()))
        found[f"export {kind}"] = Command(words, (out if kind == "obj" else "out",))
    return found


def make_files(folder: Path) -> None:
    """Write what the commands read."""
    from dataclasses import replace

    from garment_jax.config import to_toml
    from garment_jax.model.store import save_model
    from tests.animation.tiny_model import CONFIG, SCENE, tiny_model
    from tests.reference.files import write_body, write_bvh, write_obj
    from tests.reference.scene import make_motion, write_clip

    save_model(tiny_model(), folder / "model")
    for k in (1, 2, 3):
        motion = make_motion(SCENE, 8, seed=k)
        write_clip(folder / f"clips/train/waltz_{k}.h5", scene=SCENE, motion=motion)
    write_clip(folder / "clips/test/polka.h5", scene=SCENE, motion=make_motion(SCENE, 6, seed=8))
    short = {name: replace(getattr(CONFIG, name), steps=2) for name in ("generative", "motion", "detail")}
    short["motion"] = replace(short["motion"], warm_up_steps=2)
    (folder / "tiny.toml").write_text(to_toml(replace(CONFIG, **short)))
    configs = Path(__file__).parents[2] / "configs"
    lines = (configs / "benchmark.toml").read_text().replace('"skirt.toml"', '"tiny.toml"').splitlines()
    (folder / "bench.toml").write_text("\n".join(line for line in lines if not line.startswith("floor")))
    write_body(folder / "body.npz", SCENE.body)
    write_body(folder / "scaled.npz", SCENE.body._replace(skin_weights=SCENE.body.skin_weights * 2))
    write_obj(folder / "cloth.obj", SCENE.garment)
    write_bvh(folder / "walk.bvh", SCENE.body, make_motion(SCENE, 8))


def contents(folder: Path, command: Command) -> dict[str, bytes]:
    """Return what a command has made, by path; of what differs from run to run the arrays' digests."""
    found: dict[str, bytes] = {}
    for name in command.makes:
        path = folder / name
        files = [p for p in path.rglob("*") if p.is_file()] if path.is_dir() else [path]
        for file in filter(Path.exists, files):
            known = str(file.relative_to(folder))
            if ".partial/" in known or not command.arrays:
                found[known] = file.read_bytes()
            elif file.suffix == ".h5":
                found[known] = _arrays(file)
            elif "checkpoints" not in file.parts:  # logs with times, caches with digests of their own
                found[known] = b""
        steps = sorted((path / "checkpoints").glob("*/[0-9]*")) if command.arrays else []
        for step, leaves in zip(steps, _leaves(steps), strict=True):
            found[str(step.relative_to(folder))] = leaves
    return found


def digest_of(folder: Path) -> bytes:
    """Return a digest of all names and contents below."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        content = (
            os.readlink(path).encode() if path.is_symlink() else b"" if path.is_dir() else path.read_bytes()
        )
        for part in (str(path.relative_to(folder)).encode(), content):
            digest.update(len(part).to_bytes(8) + part)
    return digest.digest()


def _arrays(path: Path) -> bytes:
    import h5py

    digest = hashlib.sha256()
    with h5py.File(path) as file:
        names: list[str] = []
        file.visit(names.append)
        for name in sorted(names):
            item = file[name]
            if isinstance(item, h5py.Dataset):
                digest.update(name.encode() + np.asarray(item[()]).astype("S").tobytes())
    return digest.digest()


def _leaves(steps: Sequence[Path]) -> list[bytes]:
    """Return a digest of each checkpoint's arrays; its files hold times and names of their own."""
    keys = [digest_of(step) for step in steps]
    new = {key: step for key, step in zip(keys, steps, strict=True) if key not in _KNOWN}

    def read(place: Path) -> None:
        from garment_jax.training.checkpoint import Checkpointer

        for number, step in enumerate(new.values()):
            leaves = Checkpointer(step.parents[2], step.parent.name)._read(int(step.name))
            digest = hashlib.sha256()
            for name, (_, value) in sorted(leaves.items()):
                digest.update(name.encode() + np.ascontiguousarray(value).tobytes())
            (place / str(number)).write_bytes(digest.digest())

    if new:  # reading takes a process of its own, since it begins jax, and a second
        with tempfile.TemporaryDirectory() as name:
            in_a_fork(read, Path(name))
            _KNOWN.update({key: (Path(name) / str(k)).read_bytes() for k, key in enumerate(new)})
    return [_KNOWN[key] for key in keys]


def listing(folder: Path) -> set[str]:
    """Return all paths below; of a checkpoint's state, whose files have random names, the folder alone."""
    return {str(path.relative_to(folder)).partition("/state/")[0] for path in folder.rglob("*")}


@contextlib.contextmanager
def copied(source: Path):
    """Give a copy of the folder of inputs."""
    with tempfile.TemporaryDirectory(prefix="kills-", ignore_cleanup_errors=True) as name:
        folder = Path(name).resolve() / "work"
        shutil.copytree(source, folder)
        yield folder
