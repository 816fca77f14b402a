"""Run the commands of README and docs, as they stand, on small files that have the names they use.

    python -m tests.docs_check.run               all
    python -m tests.docs_check.run docs/export.md README.md

Every document has a folder of its own, so its commands run one after the other as a reader types them. The
configurations there are those of a tiny model, and numbers of steps are 4. What is left out is named with the
reason; a synopsis with options in brackets is run with them. The exit code is 1 where a command failed.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.cli import main as garment_jax
from garment_jax.config import to_toml
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.model.store import save_model
from tests.animation.tiny_model import CONFIG, SCENE, tiny_model
from tests.docs_check.documents import DOCUMENTS, ROOT, Command, commands
from tests.docs_check.test_documents import meant
from tests.importers.glb_files import write_glb
from tests.importers.vto_files import write_vto
from tests.reference.files import write_body, write_bvh, write_obj
from tests.reference.scene import make_motion, write_clip
from tests.reference.tiny_column_rnn import COLUMNS

LONGEST = 900  # seconds of a command
LEFT_OUT = {  # words that a command has, and why it is not run here
    "make": "the two commands of the README, run by hand and by continuous integration",
    "learn": "minutes; tests/learning/test_learn.py runs it whole, in small",
    "benchmark": "minutes; tests/bench/test_runner.py runs it whole, in small",
    "stability": "minutes; tests/stability runs its groups",
    "embedded": "minutes; make demo does what it does",
    "cuda": "needs a GPU",
    "--farm": "needs a Dask scheduler; tests/farm/test_dask.py has one",
    "$SLURM_ARRAY_TASK_ID/16": "a queue fills it in; tests/farm/test_shard.py runs shards",
    "--json": "a list of options, some for other kinds of files; tests/validation has them",
    "--coordinator": "needs several processes; tests/training/test_devices.py has them",
    "cloth/*.abc": "needs Blender",
    "FLAT": "needs a garment's sewing pattern",
    "smplh.npz": "needs a licensed body",
    "bodies": "needs a body of changing vertices; tests/importers/test_clips.py has one",
    "--times": "needs an idle machine for minutes",
    "--errors": "needs an idle machine for minutes",
    "usd|glb|pc2|mdd|obj|npz|abc": "a list of formats; each has its own line elsewhere",
}


def make_files(folder: Path) -> None:
    """Write what the documents' commands read, by their names."""
    short = {name: replace(getattr(CONFIG, name), steps=2) for name in ("generative", "motion", "detail")}
    short["motion"] = replace(short["motion"], warm_up_steps=2)
    short["column_rnn"] = replace(COLUMNS, steps=2)
    tiny = to_toml(replace(CONFIG, data=replace(CONFIG.data, validation=(), mirror=False), **short))
    for name in ("configs/skirt.toml", "configs/demo.toml", "models/mine.work/config.toml"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(tiny)
    for clips in ("data/skirt", "data/mine", "models/mine.work/clips"):
        for k, name in enumerate(("waltz", "polka", "walk")):
            write_clip(
                folder / clips / f"train/{name}.h5", scene=SCENE, motion=make_motion(SCENE, 12, seed=k)
            )
        write_clip(folder / clips / "test/jump.h5", scene=SCENE, motion=make_motion(SCENE, 8, seed=8))
    one = folder / "data/mine/test/jump.h5"
    (folder / "runs/demo/model.work/predicted").mkdir(parents=True)
    for name in ("CLIP", "SEQUENCE", "PRED", "TRUTH", "POSE", "mine", "pred", "truth"):
        shutil.copy(one, folder / f"{name}.h5")
    shutil.copytree(one.parent, folder / "CLIPS")
    shutil.copytree(one.parent, folder / "FILES")
    with SequenceWriter(
        folder / "runs/demo/model.work/predicted/dance.h5", SCENE, make_motion(SCENE, 8), encoding="int16"
    ) as writer:
        writer.append(np.repeat(SCENE.garment.template[None], 8, axis=0))
    save_model(tiny_model(), folder / "plain")
    for name in ("models/skirt", "models/mine", "RUN", "MODEL"):
        words = ["save", str(folder / "plain"), "--scene", str(one), "--out", str(folder / name)]
        if garment_jax(words):
            raise SystemExit("docs-check: the tiny model could not be saved")
    write_glb(folder / "me.glb", SCENE.body)
    write_body(folder / "me.npz", SCENE.body)
    write_obj(folder / "skirt.obj", SCENE.garment)
    for name in ("demo.obj", "X.obj"):
        shutil.copy(folder / "skirt.obj", folder / name)
    shutil.copy(folder / "configs/demo.toml", folder / "demo")  # the package's configuration of that name
    (folder / "moves").mkdir()
    for k, name in enumerate(("walk", "run", "jump")):
        write_bvh(folder / f"moves/{name}.bvh", SCENE.body, make_motion(SCENE, 18, seed=k))
    shutil.copy(folder / "moves/walk.bvh", folder / "walk.bvh")
    frames = {f"tshirt_shape00_{name}": 12 for name in ("01_01", "01_02", "09_01")}
    write_vto(folder, frames).rename(folder / "tshirt")


def reason(command: Command) -> str:
    """Return why a command is not run; "" where it is."""
    words = [word.strip("[]") for word in command.words]
    return next((why for word, why in LEFT_OUT.items() if word in words), "")


def run(command: Command, folder: Path) -> str:
    """Run a command in a folder; return the end of what it said where it failed."""
    name, *words = meant(command.words)
    if words[:1] == ["simulate"] and "--out" in words:  # a reader's is new; here it holds imported clips
        shutil.rmtree(folder / words[words.index("--out") + 1], ignore_errors=True)
    words = [
        "4" if before.endswith("steps") else word for before, word in zip(["", *words], words, strict=False)
    ]
    program = ["-m", "garment_jax"] if name == "garment-jax" else [str(ROOT / name)]
    settings = {"JAX_PLATFORMS": "cpu", "JAX_DISABLE_MOST_OPTIMIZATIONS": "1", "PYTHONPATH": str(ROOT)}
    settings["GARMENT_JAX_CACHE"] = str(ROOT / ".cache" / "docs_check")
    try:
        done = subprocess.run(
            [sys.executable, *program, *words],
            cwd=folder,
            env={**os.environ, **settings},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LONGEST,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"not ended after {LONGEST} s"
    return "" if done.returncode == 0 else (done.stderr.strip() or done.stdout.strip())[-400:]


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description="Run the commands of README and docs in small.")
    parser.add_argument("documents", nargs="*", type=Path, help="default: all")
    chosen = [path.resolve() for path in parser.parse_args().documents] or list(DOCUMENTS)
    failed = ran = 0
    with tempfile.TemporaryDirectory(prefix="docs-check-") as name:
        source = Path(name).resolve() / "files"
        make_files(source)
        for document in chosen:
            folder = source.with_name(document.stem)
            shutil.copytree(source, folder)
            for command in dict.fromkeys(c for c in commands(document) if c.whole):
                why, began = reason(command), time.monotonic()
                fault = "" if why else run(command, folder)
                if "--force replaces it" in fault:  # an earlier line of the page has made it
                    fault = run(command._replace(words=(*command.words, "--force")), folder)
                said = f"left out: {why}" if why else "FAILED" if fault else "ok"
                took = "" if why else f", {time.monotonic() - began:.0f} s"
                print(f"{command.place}: {' '.join(command.words)}: {said}{took}", flush=True)
                if fault:
                    print(f"    {fault}", flush=True)
                failed, ran = failed + bool(fault), ran + (not why)
    print(f"{ran} commands run, {failed} failed")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
