"""Every kind of file that is read, damaged many times: what a user sees is one sentence, or all is well.

`python -m tests.fuzz.damaged_files --files 250` tries so many of each kind and prints what it counted; the
test beside this tries a few of each. A command runs in a fork of this process, with its time and memory
bounded and measured.
"""

import argparse
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.data.packed import write_packed
from tests.fuzz.mutations import mutate
from tests.intake.good_files import SCENE, V, write_all, write_usd
from tests.reference.scene import write_clip

SECONDS, MEMORY = 60, 500 * 2**20  # of one command
_OWN = "--garment skirt.obj --body me.npz"
_SMPL = "--garment skirt/skirt.obj --fit-uv --body smpl.pkl"
_CACHE = f"{_OWN} --motion walk.bvh --clip-unit m --clip-up Y --format meshes"
_BONES = "--format virtualbones --body smpl.pkl --fps 30 --clip-up Y --motion-up Y"
# kind: the file that is damaged, what is imported of the folder that it stands in ("" where nothing is)
KINDS = {
    "sequence": ("clip.h5", ""),
    "motion alone": ("clip.h5", f"clip.h5 {_OWN} --format motion"),
    "packed clip": ("packed/skirt/train_waltz.h5", "packed/skirt/train_waltz.h5"),
    "garment": ("skirt.obj", f"walk.bvh {_OWN}"),
    "body .npz": ("me.npz", f"walk.bvh {_OWN}"),
    "body .glb": ("me.glb", "walk.bvh --garment skirt.obj --body me.glb"),
    "body .pkl": ("smpl.pkl", f"amass.npz {_SMPL}"),
    "bvh": ("walk.bvh", f"walk.bvh {_OWN}"),
    "amass": ("amass.npz", f"amass.npz {_SMPL}"),
    "aist": ("aist.pkl", f"aist.pkl {_SMPL}"),
    "joint table": ("joints.toml", f"walk.bvh {_OWN} --joints joints.toml"),
    "virtualbones": ("dress02/1.npz", f"dress02 {_BONES}"),
    "vto": ("skirt/simulations/walk.pkl", "skirt --format vto --body smpl.pkl"),
    "pc2": ("walk.pc2", f"walk.pc2 {_CACHE} --fps 30"),
    "mdd": ("walk.mdd", f"walk.mdd {_CACHE}"),
    "obj frames": ("walk/walk_2.obj", f"walk {_CACHE} --fps 30"),
    "ply frames": ("walk.ply/1.ply", f"walk.ply {_CACHE} --fps 30"),
    "usda": ("walk.usda", f"walk.usda {_CACHE}"),
    "usdc": ("walk.usdc", f"walk.usdc {_CACHE}"),
    "configuration": ("run/config.toml", ""),
    "figures": ("run/figures.json", ""),
}
_INFO = ("sequence", "motion alone", "configuration", "figures")
_NET = re.compile(r"is damaged: [A-Z]\w+ ")


class Trial(NamedTuple):
    """What a command did with a damaged file."""

    code: int  # exit code, negative for a signal
    memory: int  # bytes at most
    text: str  # of stderr
    shown: str  # of stdout


def write_good(folder: Path) -> None:
    """Write a good file of every kind."""
    write_all(folder)
    write_clip(folder / "clip.h5", 6)
    write_packed(folder / "packed")
    table = [f'{name} = "{name}"' for name in SCENE.body.joint_names]
    (folder / "joints.toml").write_text("\n".join([*table, ""]))
    (folder / "run").mkdir()
    (folder / "run/config.toml").write_text("seed = 3\n[uv]\nsize = 64\n[motion]\nsteps = 100\nlr = 1e-4\n")
    (folder / "run/figures.json").write_text('{"rmse_cm": 3.5, "of": {"a": [1, 2, {"b": "c"}]}}')
    write_usd(folder / "walk.usda", V)
    try:
        from pxr import Sdf

        Sdf.Layer.FindOrOpen(str(folder / "walk.usda")).Export(str(folder / "walk.usdc"))
    except ImportError:
        (folder / "walk.usda").unlink()


def commands(kind: str) -> list[list[str]]:
    """Return the commands that read a kind's file."""
    name, imported = KINDS[kind]
    folder = str(Path(name).parent)
    shown = folder if folder.endswith(("walk", ".ply", "run")) else name
    found = [] if kind in ("joint table", "configuration", "figures") else [["validate", shown]]
    found += [["info", shown]] if kind in _INFO else []
    return found + ([["import", *imported.split(), "--out", "out"]] if imported else [])


def run(arguments: list[str], folder: Path) -> Trial:
    """Run a command in a fork of this process, in `folder`, without what it wrote before."""
    shutil.rmtree(folder / "out", ignore_errors=True)
    child = os.fork()
    if child == 0:
        _be_the_command(arguments, folder)
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    texts = [(folder / name).read_text(errors="replace") for name in ("stderr", "stdout")]
    return Trial(code, used.ru_maxrss * 1024, *texts)


def _be_the_command(arguments: list[str], folder: Path) -> None:
    try:
        os.chdir(folder)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(SECONDS)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for name, stream in (("stdout", 1), ("stderr", 2)):
            os.dup2(os.open(name, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), stream)
        sys.stdout = os.fdopen(1, "w", closefd=False)
        sys.stderr = os.fdopen(2, "w", closefd=False)
        from garment_jax.cli import main
        from garment_jax.cli.printable import show_safely

        show_safely()
        code = main(arguments)
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        import traceback

        traceback.print_exc()
        sys.stderr.flush()
        code = 99
    os._exit(code)


def judge(trial: Trial, name: str) -> set[str]:
    """Return what is wrong with a trial, a word each; "net": only `formats.damage` made it a sentence."""
    found = set()
    if "Traceback (most recent" in trial.text or trial.code in (70, 99):
        found.add("traceback")
    if trial.code < 0:
        found.add("hang" if trial.code == -signal.SIGALRM else "crash")
    lines = trial.text.splitlines()
    if any(not line.startswith("error: ") for line in lines) and "traceback" not in found:
        found.add("noise")
    if trial.memory > MEMORY:
        found.add("memory")
    stem = Path(name).stem
    if lines and not found and not re.search(r"\.[a-z0-9]{2,4}\b", lines[0]) and stem not in lines[0]:
        found.add("nameless")
    if _NET.search(trial.text + trial.shown):
        found.add("net")
    return found


def try_kind(kind: str, files: int, seed: int, keep: Path | None = None) -> tuple[Counter[str], list[str]]:
    """Damage a kind's file so many times; return the counts and a line for each thing wrong."""
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    name = KINDS[kind][0]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_good(folder)
        if not (folder / name).is_file():
            return counts, wrong
        good = (folder / name).read_bytes()
        for i in range(files):
            rng = np.random.default_rng([seed, sum(kind.encode()), i])
            damaged = mutate(good, Path(name).suffix, rng)
            (folder / name).write_bytes(damaged)
            counts["files"] += 1
            for arguments in commands(kind):
                trial = run(arguments, folder)
                found = judge(trial, name)
                counts.update(found)
                counts[f"exit {trial.code}"] += 1
                counts["most MB"] = max(counts["most MB"], trial.memory // 2**20)
                for word in sorted(found):
                    last = (trial.text.strip().splitlines() or trial.shown.strip().splitlines() or [""])[-1]
                    wrong.append(f"{word}: {kind} {i} {arguments[0]}: {last[:300]}")
                    if keep is not None:
                        keep.mkdir(exist_ok=True)
                        target = keep / f"{word}_{kind}_{i}_{arguments[0]}{Path(name).suffix}".replace(
                            " ", "-"
                        )
                        target.write_bytes(damaged)
                        target.with_suffix(".txt").write_text(trial.text + trial.shown)
    return counts, wrong


def main() -> None:
    """Run the long form and print its counts."""
    parser = argparse.ArgumentParser(description="Damage files of every kind and read them.")
    parser.add_argument("--files", type=int, default=250, help="of each kind (default 250)")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), metavar="KIND")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="folder for the files with which something was wrong")
    options = parser.parse_args()
    load()
    total: Counter[str] = Counter()
    for kind in options.kinds:
        counts, wrong = try_kind(kind, options.files, options.seed, options.keep)
        most = max(total.pop("most MB", 0), counts["most MB"])
        total.update({word: count for word, count in counts.items() if word != "most MB"})
        total["most MB"] = most
        print("\n".join([f"{kind}: {dict(counts)}", *wrong]), flush=True)
    print(f"all: {dict(total)}")


def load() -> None:
    """Import what the commands use, once for all forks."""
    import garment_jax.data.importer
    import garment_jax.export.command
    import garment_jax.intake.clips
    import garment_jax.intake.formats
    import garment_jax.validator.report
    import garment_jax.validator.validate  # noqa: F401


if __name__ == "__main__":
    main()
