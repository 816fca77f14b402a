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

from tests.fuzz.command_lines import run_words, share_programs
from tests.fuzz.kinds import KINDS, write_good
from tests.fuzz.mutations import mutate

SECONDS, MEMORY = 60, 500 * 2**20  # of one command
COMPILING = 600  # seconds: clips of another length are animated by programs of their own
_NET = re.compile(r"is damaged: [A-Z]\w+ ")
# what a command says on stderr beside a refusal: progress, a checkpoint passed over, a joint table to fill
_SAID = re.compile(
    r"error: |#|.* = \".*\"$|left out: |(train|infer): .* -> |prepare: |.*\d+ of \d+ |.*\d+/\d+ frames"
    r"|.* is taken$|.* may lag or stretch\.$|$"
)


class Trial(NamedTuple):
    """What a command did with a damaged file."""

    code: int  # exit code, negative for a signal
    memory: int  # bytes at most
    text: str  # of stderr
    shown: str  # of stdout


def run(arguments: list[str], folder: Path, *, seconds: int = SECONDS) -> Trial:
    """Run a command in a fork of this process, in `folder`, without what it wrote before."""
    shutil.rmtree(folder / "out", ignore_errors=True)
    child = os.fork()
    if child == 0:
        _be_the_command(arguments, folder, seconds)
    _, status, used = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    texts = [(folder / name).read_text(errors="replace") for name in ("stderr", "stdout")]
    return Trial(code, used.ru_maxrss * 1024, *texts)


def _be_the_command(arguments: list[str], folder: Path, seconds: int) -> None:
    try:
        os.chdir(folder)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(seconds)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for name, stream in (("stdout", 1), ("stderr", 2)):
            os.dup2(os.open(name, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), stream)
        sys.stdout = os.fdopen(1, "w", closefd=False)
        sys.stderr = os.fdopen(2, "w", closefd=False)
        from garment_jax.cli.printable import show_safely

        show_safely()
        code = run_words(arguments)
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
    lines = [line for line in trial.text.splitlines() if not line.startswith("next: ")]
    if any(not _SAID.match(line) for line in lines) and "traceback" not in found:
        found.add("noise")
    if trial.memory > MEMORY:
        found.add("memory")
    names = (Path(name).stem, *Path(name).parent.parts)
    if lines and not found and not re.search(r"\.[a-z0-9]{2,4}\b|" + "|".join(names), lines[0]):
        found.add("nameless")
    if _NET.search(trial.text + trial.shown):
        found.add("net")
    return found


def try_kind(
    kind: str, files: int, seed: int, good_files: Path, keep: Path | None = None
) -> tuple[Counter[str], list[str]]:
    """Damage a kind's file so many times; return the counts and a line for each thing wrong.

    `good_files` is a folder for those of all kinds, made where they are not there.
    """
    counts: Counter[str] = Counter()
    wrong: list[str] = []
    name, commands, needs = KINDS[kind]
    seconds = COMPILING if needs == "programs" else SECONDS
    with tempfile.TemporaryDirectory() as temporary:
        folder, source = Path(temporary) / "case", good_files / (needs or "none")
        if not source.exists():
            source.mkdir()
            write_good(source, kind)
        shutil.copytree(source, folder)
        if not (folder / name).is_file():
            if needs:  # of those without a need USD alone may be missing
                raise RuntimeError(f"{kind}: {source} holds no {name}")
            return counts, wrong
        good = (folder / name).read_bytes()
        if needs == "programs":
            for words in commands:
                run(words.split(), folder, seconds=seconds)
        for i in range(files):
            rng = np.random.default_rng([seed, sum(kind.encode()), i])
            damaged = mutate(good, Path(name).suffix, rng)
            (folder / name).write_bytes(damaged)
            counts["files"] += 1
            for arguments in map(str.split, commands):
                trial = run(arguments, folder, seconds=seconds)
                found = judge(trial, name)
                found -= {"memory"} if needs == "programs" and not trial.code else set()  # XLA's
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
    with tempfile.TemporaryDirectory() as folder:
        share_programs(Path(folder) / "compiled")
        load(jax=any(KINDS[kind].needs for kind in options.kinds))
        _run_kinds(options, Path(folder))


def _run_kinds(options: argparse.Namespace, good_files: Path) -> None:
    total: Counter[str] = Counter()
    for kind in options.kinds:
        counts, wrong = try_kind(kind, options.files, options.seed, good_files, options.keep)
        most = max(total.pop("most MB", 0), counts["most MB"])
        total.update({word: count for word, count in counts.items() if word != "most MB"})
        total["most MB"] = most
        print("\n".join([f"{kind}: {dict(counts)}", *wrong]), flush=True)
    print(f"all: {dict(total)}")


def load(*, jax: bool) -> None:
    """Import what the commands use, once for all forks; what animates and trains with `jax` alone."""
    import garment_jax.exporters.command
    import garment_jax.importers.clips
    import garment_jax.importers.formats
    import garment_jax.io.importer
    import garment_jax.validation.report
    import garment_jax.validation.validate

    if jax:
        import garment_jax.animation.animate
        import garment_jax.animation.collide
        import garment_jax.training.pipeline
        import garment_jax.training.run  # noqa: F401


if __name__ == "__main__":
    main()
