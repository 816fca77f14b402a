"""Every command that writes, killed at every file operation; and pairs of commands at once in one folder.

    python -m tests.fuzz.kills                       a minute: the quick commands, every few operations
    python -m tests.fuzz.kills --long                all commands, every operation, all pairs
    python -m tests.fuzz.kills --only save --long    one of them
    python -m tests.fuzz.kills --long --no-kills     all pairs

Just before every operation the command stands still while its folder is copied: that is what signal 9 leaves.
In every copy that differs from the others no final file may be torn (it is the old one, the finished one or
not there), the same command must end with the files of the uninterrupted one, byte for byte (of runs and of
files that hold the time: with the same arrays), and nothing else may be left. One that finds a final file is
refused and must do all that with `--force`. Commands run in forks of one
process that has imported everything.
"""

import argparse
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from tests.fuzz.command_lines import in_a_fork, share_programs
from tests.fuzz.pairs import PAIRS, pair_run
from tests.fuzz.watched_runs import Ended, run, run_stopping
from tests.fuzz.writing_commands import (
    Command,
    commands,
    contents,
    copied,
    digest_of,
    listing,
    make_files,
)

QUICK = ("evaluate", "export npz", "export pc2", "export obj", "save")  # the last takes seconds


def kill_run(
    name: str, command: Command, source: Path, chosen: Callable[[int], Sequence[int]], until: float
) -> tuple[int, list[str]]:
    """Go on from what kills leave, as `chosen` picks them; return how many kills, and what went wrong."""
    with copied(source) as ready:
        if command.before:
            run(commands()[command.before], ready)
        return _kill_run(name, command, ready, chosen, until)


def _kill_run(
    name: str, command: Command, source: Path, chosen: Callable[[int], Sequence[int]], until: float
) -> tuple[int, list[str]]:
    with copied(source) as folder, tempfile.TemporaryDirectory(prefix="kills-left-") as place:
        left: dict[bytes, list[int]] = {}  # by what it holds, before which operations

        def keep(number: int) -> None:
            state = digest_of(folder)
            left.setdefault(state, []).append(number)
            if len(left[state]) == 1:
                shutil.copytree(folder, Path(place) / str(number), symlinks=True)

        whole = run_stopping(command, folder, keep)
        if whole.code not in (0, 1):  # 1: `validate` has found faults
            return 0, [f"{name}: it does not run: {whole.said.strip()[-300:]}"]
        expected, there = contents(folder, command), listing(folder)
        states = list(left.values())
        points = [states[k - 1] for k in chosen(len(states))]
        said = f"{name}: {whole.operations} operations, {len(states)} states, {len(points)} to go on from"
        print(said, flush=True)
        faults, covered = [], 0
        for numbers in points:
            if time.monotonic() > until:
                break
            covered += len(numbers)
            shutil.rmtree(folder)
            (Path(place) / str(numbers[0])).rename(folder)
            wrong = _goes_on(f"{name} at {numbers[0]}", command, folder, whole, expected, there)
            faults += wrong
            for fault in wrong:  # a run takes an hour: what it finds is said at once
                print(fault, flush=True)
            if covered % 10 < len(numbers):
                print(f"{name}: {covered} of {whole.operations}", flush=True)
        return covered, faults


def _goes_on(
    title: str, command: Command, folder: Path, whole: Ended, expected: dict[str, bytes], there: set[str]
) -> list[str]:
    """Return what is wrong with what a kill left, and with what the same command makes of it."""
    faults = []
    for path, content in contents(folder, command).items():
        scratch = ".partial/" in path or Path(path).name.startswith(".") or ".replaced" in path
        early = "checkpoints/" in path and path not in expected  # a step before the last
        if not scratch and not early and content != expected.get(path):
            faults.append(f"{title}: {path} is torn")
    again = run(command, folder)
    if again.code == 2 and "--force replaces it" in again.said:
        again = run(command._replace(words=(*command.words, "--force")), folder)
    if again.code != whole.code:
        return [*faults, f"{title}: again: {again.code}: {again.said.strip()[-300:]}"]
    if contents(folder, command) != expected:
        faults.append(f"{title}: the same command goes on to another result")
    if left := sorted(listing(folder) - there):
        faults.append(f"{title}: left over: {left[:3]}")
    return faults


def main() -> int:
    """Run it; the exit code is 1 where anything went wrong."""
    parser = argparse.ArgumentParser(description="Kill commands at their file operations; run pairs at once.")
    parser.add_argument("--long", action="store_true", help="all commands, all operations, all pairs")
    parser.add_argument("--only", nargs="*", default=[], help="names of commands")
    parser.add_argument("--no-kills", action="store_true", help="the pairs alone")
    parser.add_argument("--seconds", type=float, default=0, help="begin no further kill after these")
    parser.add_argument("--pairs", type=int, default=20, help="of every combination, with --long")
    parser.add_argument(
        "--programs", type=Path, help="folder that keeps what jax compiles, for the next time"
    )
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kills-programs-") as programs:
        share_programs(options.programs or Path(programs))
        return _run(options)


def _run(options: argparse.Namespace) -> int:
    seconds = options.seconds or (1e9 if options.long else 25)
    rng = random.Random(options.seed)

    def chosen(count: int) -> Sequence[int]:
        if not options.long:
            return sorted(rng.sample(range(1, count + 1), min(count, 6)))
        return range(1, count + 1)

    found = commands()
    names = options.only or (list(found) if options.long else QUICK)
    failures: list[str] = []
    with tempfile.TemporaryDirectory(prefix="kills-inputs-") as place:
        source = Path(place).resolve()
        in_a_fork(make_files, source)  # JAX must not have begun to compute here, or no fork could
        _import_everything()
        until = time.monotonic() + seconds
        for name in names:
            if name in found and not options.no_kills:
                runs, faults = kill_run(name, found[name], source, chosen, until)
                print(f"{name}: {runs} kills, {len(faults)} faults", *faults, sep="\n  ", flush=True)
                failures += faults
        for pair in PAIRS if options.pairs else ():
            if pair.first in names and (options.long or pair.first in ("save", "export pc2")):
                runs, faults = pair_run(pair, source, options.pairs if options.long else 2, options.seed)
                title = f"{pair.first} + {pair.second}: {runs} pairs, {len(faults)} faults"
                print(title, *faults, sep="\n  ", flush=True)
                failures += faults
    return bool(failures)


def _import_everything() -> None:
    """Import what the commands import when they run, so that a fork begins at once."""
    import infer  # noqa: F401
    import train  # noqa: F401
    from garment_jax.animation import animate, collide  # noqa: F401
    from garment_jax.cli import make_parser
    from garment_jax.evaluation import render  # noqa: F401
    from garment_jax.exporters import command as _  # noqa: F401
    from garment_jax.importers import clips, scenes  # noqa: F401
    from garment_jax.training import pipeline, run  # noqa: F401

    make_parser()


if __name__ == "__main__":
    sys.exit(main())
