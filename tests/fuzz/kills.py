"""Every command that writes, killed at every file operation; and pairs of commands at once in one folder.

    python -m tests.fuzz.kills                       a minute: the quick commands, every few operations
    python -m tests.fuzz.kills --long                all commands, every operation, all pairs
    python -m tests.fuzz.kills --only save --long    one of them

A kill is signal 9 just before the operation. Afterwards no final file may be torn (it is the old one, the
finished one or not there), the same command must end with the files of the uninterrupted one, byte for byte,
and nothing else may be left. Commands run in forks of one process that has imported everything.
"""

import argparse
import contextlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
CHANGING = ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.truncate")
QUICK = ("save", "export npz", "export pc2", "export obj", "evaluate")  # take no second each


class Command(NamedTuple):
    """A command line, run in a folder that holds what it reads."""

    words: tuple[str, ...]
    makes: tuple[str, ...]  # files and folders, compared afterwards
    changes: bool = True  # a time or a path in what it writes differs from run to run: not compared


class Ended(NamedTuple):
    """How a run ended."""

    code: int  # negative: the signal
    said: str  # on stderr
    operations: int  # file operations up to its end


def commands() -> dict[str, Command]:
    """Return the commands by name."""
    model, clip = "model", "clips/test/polka.h5"
    exports = {"npz": "npz", "pc2": "pc2", "mdd": "mdd", "glb": "glb", "obj": "frames", "usd": "usda"}
    found = {
        "save": Command(("save", "model", "--out", "out", "--bits", "32"), ("out",)),
        "evaluate": Command(("evaluate", clip, clip, "--out", "figures.json"), ("figures.json",), False),
        "render": Command(("render", clip, "--out", "sheet.png", "--frames", "2"), ("sheet.png",)),
        "view": Command(("view", clip, "--out", "page.html"), ("page.html",)),
        "collide": Command(("collide", clip, "--out", "out/solved.h5"), ("out",)),
        "import": Command(
            ("import", "walk.bvh", "--body", "body.npz", "--garment", "cloth.obj", "--out", "got"), ("got",)
        ),
        "validate": Command(("validate", "scaled.npz", "--fix", "--out", "fixed"), ("fixed",)),
        "infer": Command(("infer.py", model, "--motion", clip, "--out", "pred.h5"), ("pred.h5",), False),
        "train": Command(("train.py", "tiny.toml", "--data", "clips", "--run-dir", "run"), ("run",), False),
    }
    for kind, name in exports.items():
        out = name if kind == "obj" else f"out/walk.{name}"
        words = ("export", clip, "--out", out, *(("--format", "obj") if kind == "obj" else ()))
        found[f"export {kind}"] = Command(words, (out if kind == "obj" else "out",))
    return found


def make_files(folder: Path) -> None:
    """Write what the commands read."""
    from garment_jax.config import to_toml
    from garment_jax.rollout.model import save_model
    from tests.reference.files import write_body, write_bvh, write_obj
    from tests.reference.scene import make_motion, write_clip
    from tests.rollout.tiny_model import CONFIG, SCENE, tiny_model

    save_model(tiny_model(), folder / "model")
    for k, frames in enumerate((16, 14, 14), start=1):
        motion = make_motion(SCENE, frames, seed=k)
        write_clip(folder / f"clips/train/waltz_{k}.h5", scene=SCENE, motion=motion)
    write_clip(folder / "clips/test/polka.h5", scene=SCENE, motion=make_motion(SCENE, 6, seed=8))
    (folder / "tiny.toml").write_text(to_toml(CONFIG))
    write_body(folder / "body.npz", SCENE.body)
    write_body(folder / "scaled.npz", SCENE.body._replace(skin_weights=SCENE.body.skin_weights * 2))
    write_obj(folder / "cloth.obj", SCENE.garment)
    write_bvh(folder / "walk.bvh", SCENE.body, make_motion(SCENE, 8))


def run(command: Command, folder: Path, *, kill_at: int = 0) -> Ended:
    """Run a command in `folder`, in a fork; signal 9 comes before its operation of the number `kill_at`."""
    child, said = start(command, folder, kill_at=kill_at)
    return finish(child, said)


def start(command: Command, folder: Path, *, kill_at: int = 0) -> tuple[int, Path]:
    said = Path(tempfile.mkdtemp(prefix="kills-said-"))
    child = os.fork()
    if child == 0:
        code = 70
        try:
            code = _run_here(command, folder, said, kill_at)
        except SystemExit as leaving:
            code = leaving.code if isinstance(leaving.code, int) else 1
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    return child, said


def finish(child: int, said: Path) -> Ended:
    status = os.waitpid(child, 0)[1]
    count = said / "count"
    operations = len(count.read_bytes()) if count.exists() else 0
    text = (said / "stderr").read_text(errors="replace") if (said / "stderr").exists() else ""
    shutil.rmtree(said)
    return Ended(os.waitstatus_to_exitcode(status), text, operations)


def _run_here(command: Command, folder: Path, said: Path, kill_at: int) -> int:
    os.chdir(folder)
    for number, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(said / name, os.O_WRONLY | os.O_CREAT), number)
    counting = os.open(said / "count", os.O_WRONLY | os.O_CREAT)
    done = 0

    def watch(event: str, given: tuple) -> None:
        nonlocal done
        if event == "open":
            path, _, flags = given
            if not isinstance(flags, int) or not flags & WRITING or not _below(path, folder):
                return
        elif event not in CHANGING or not _below(given[0], folder):
            return
        done += 1
        os.write(counting, b".")
        if done == kill_at:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(watch)
    program = command.words[0]
    if program in ("train.py", "infer.py"):
        import importlib

        sys.argv = list(command.words)
        return importlib.import_module(program.removesuffix(".py")).main()
    from garment_jax.cli import main

    return main(list(command.words))


def _below(path: object, folder: Path) -> bool:
    if not isinstance(path, str | bytes | os.PathLike):
        return True  # a descriptor of what was opened here
    text = os.fsdecode(path)
    return not os.path.isabs(text) or text.startswith(str(folder))


def contents(folder: Path, command: Command) -> dict[str, bytes]:
    """Return what a command has made, by path; of what differs from run to run, the names alone."""
    found = {}
    for name in command.makes:
        path = folder / name
        files = [p for p in path.rglob("*") if p.is_file()] if path.is_dir() else [path]
        for file in filter(Path.exists, files):
            found[str(file.relative_to(folder))] = file.read_bytes() if command.changes else b""
    return found


def listing(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@contextlib.contextmanager
def copied(source: Path):
    """Give a copy of the folder of inputs."""
    with tempfile.TemporaryDirectory(prefix="kills-", ignore_cleanup_errors=True) as name:
        folder = Path(name).resolve() / "work"
        shutil.copytree(source, folder)
        yield folder


def kill_run(
    name: str, command: Command, source: Path, chosen: Callable[[int], Sequence[int]], until: float
) -> tuple[int, list[str]]:
    """Kill a command at the operations that `chosen` picks; return how many, and what went wrong."""
    with copied(source) as folder:
        whole = run(command, folder)
        if whole.code not in (0, 1):  # 1: `validate` has found faults
            return 0, [f"{name}: it does not run: {whole.said.strip()[-300:]}"]
        expected, there = contents(folder, command), listing(folder)
    faults, runs = [], 0
    for at in chosen(whole.operations):
        if time.monotonic() > until:
            break
        with copied(source) as folder:
            killed = run(command, folder, kill_at=at)
            runs += 1
            if killed.code != -signal.SIGKILL:
                faults.append(f"{name} at {at}: ended with {killed.code}")
            for path, content in contents(folder, command).items():
                scratch = ".partial/" in path or Path(path).name.startswith(".") or ".replaced" in path
                if not scratch and command.changes and content != expected.get(path):
                    faults.append(f"{name} at {at}: {path} is torn")
            again = run(command, folder)
            if again.code != whole.code:
                faults.append(f"{name} at {at}: again: {again.code}: {again.said.strip()[-300:]}")
                continue
            if contents(folder, command) != expected:
                faults.append(f"{name} at {at}: the same command goes on to another result")
            if left := sorted(listing(folder) - there):
                faults.append(f"{name} at {at}: left over: {left[:3]}")
    return runs, faults


PAIRS = (
    ("train", "train"),
    ("save", "save"),
    ("import", "import"),
    ("train", "infer"),
    ("export pc2", "export pc2"),
    ("export npz", "export npz"),
    ("export obj", "export obj"),
    ("export glb", "export glb"),
    ("collide", "collide"),
    ("evaluate", "evaluate"),
)


def pair_run(names: tuple[str, str], source: Path, times: int, seed: int) -> tuple[int, list[str]]:
    """Start two commands at once in one folder; return how often, and what went wrong."""
    rng, faults, found = random.Random(seed), [], commands()
    both = [found[name] for name in names]
    expected: dict[str, bytes] = {}
    there: set[str] = set()
    with copied(source) as folder:
        for command in both:
            run(command, folder)
        for command in both:
            expected |= contents(folder, command)
        there = listing(folder)
    for _ in range(times):
        with copied(source) as folder:
            first = start(both[0], folder)
            time.sleep(rng.uniform(0, 0.3))
            second = start(both[1], folder)
            ends = [finish(*first), finish(*second)]
            what = f"{names[0]} + {names[1]}"
            if all(end.code for end in ends):
                faults.append(f"{what}: both ended in a refusal: {ends[0].said[-200:]} {ends[1].said[-200:]}")
            for end in ends:
                if end.code not in (0, 2):
                    faults.append(f"{what}: ended with {end.code}: {end.said[-500:]}")
                if "Traceback" in end.said:
                    faults.append(f"{what}: {end.said[-500:]}")
                if end.code == 2 and end.said.count("error: ") != 1:
                    faults.append(f"{what}: not one sentence: {end.said[-500:]}")
            made: dict[str, bytes] = {}
            for command, end in zip(both, ends, strict=True):
                made |= contents(folder, command) if not end.code else {}
            if any(made[path] != expected.get(path) for path in made):
                faults.append(f"{what}: another result: {sorted(set(made) ^ set(expected))[:3]}")
            if left := sorted(listing(folder) - there):
                faults.append(f"{what}: left over: {left[:3]}")
    return times, faults


def main() -> int:
    """Run it; the exit code is 1 where anything went wrong."""
    parser = argparse.ArgumentParser(description="Kill commands at their file operations; run pairs at once.")
    parser.add_argument("--long", action="store_true", help="all commands, all operations, all pairs")
    parser.add_argument("--only", nargs="*", default=[], help="names of commands")
    parser.add_argument("--seconds", type=float, default=0, help="begin no further kill after these")
    parser.add_argument("--pairs", type=int, default=20, help="of every combination, with --long")
    parser.add_argument("--stride", type=int, default=1, help="with --long, every so many operations")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ["GARMENT_JAX_CACHE"] = "off"
    seconds = options.seconds or (1e9 if options.long else 25)
    rng = random.Random(options.seed)

    def chosen(count: int) -> Sequence[int]:
        every = range(1 + rng.randrange(options.stride), count + 1, options.stride)
        return every if options.long else sorted(rng.sample(range(1, count + 1), min(count, 6)))

    found = commands()
    names = options.only or (list(found) if options.long else QUICK)
    failures: list[str] = []
    with tempfile.TemporaryDirectory(prefix="kills-inputs-") as place:
        source = Path(place).resolve()
        _in_a_fork(make_files, source)  # JAX must not have begun to compute here, or no fork could
        _import_everything()
        until = time.monotonic() + seconds
        for name in names:
            if name in found:
                runs, faults = kill_run(name, found[name], source, chosen, until)
                print(f"{name}: {runs} kills, {len(faults)} faults", flush=True)
                failures += faults
        for pair in PAIRS:
            if pair[0] in names and (options.long or pair[0] in ("save", "export pc2")):
                runs, faults = pair_run(pair, source, options.pairs if options.long else 2, options.seed)
                print(f"{pair[0]} + {pair[1]}: {runs} pairs, {len(faults)} faults", flush=True)
                failures += faults
    print(*failures, sep="\n")
    return bool(failures)


def _in_a_fork(work: Callable[[Path], None], folder: Path) -> None:
    child = os.fork()
    if child == 0:
        try:
            work(folder)
            os._exit(0)
        finally:
            os._exit(1)
    if os.waitpid(child, 0)[1]:
        raise RuntimeError("the inputs could not be made")


def _import_everything() -> None:
    """Import what the commands import when they run, so that a fork begins at once."""
    import infer  # noqa: F401
    import train  # noqa: F401
    from garment_jax.cli import make_parser
    from garment_jax.collision import command  # noqa: F401
    from garment_jax.evaluation import render  # noqa: F401
    from garment_jax.export import command as _  # noqa: F401
    from garment_jax.intake import clips, scenes  # noqa: F401
    from garment_jax.rollout import animate  # noqa: F401
    from garment_jax.training import pipeline, run  # noqa: F401

    make_parser()


if __name__ == "__main__":
    sys.exit(main())
