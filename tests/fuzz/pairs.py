"""Two commands started at once that share a folder: each ends well or in one sentence, the state is right."""

import random
import time
from pathlib import Path
from typing import NamedTuple

from tests.fuzz.watched_runs import Ended, finish, run, start
from tests.fuzz.writing_commands import Command, commands, contents, copied, listing


class Pair(NamedTuple):
    """Two commands by name."""

    first: str
    second: str
    before: str = ""  # a command that was killed half way before
    free: bool = False  # what they make depends on who comes first


PAIRS = (
    Pair("train generative", "train generative"),
    Pair("train", "train"),
    Pair("train", "infer run", before="train", free=True),
    Pair("train generative", "import clips", free=True),
    Pair("save", "save"),
    Pair("import", "import"),
    Pair("collide", "collide"),
    Pair("evaluate", "evaluate"),
    Pair("infer", "infer"),
    *(Pair(f"export {kind}", f"export {kind}") for kind in ("npz", "pc2", "mdd", "obj", "glb", "usd")),
    Pair("export pc2", "export mdd", free=True),  # both write walk.obj; who comes second is refused
    Pair("export npz", "export glb"),
    Pair("validate", "validate"),
    Pair("simulate", "simulate"),
    Pair("floor", "floor"),
    Pair("render", "render"),
    Pair("view", "view"),
    Pair("benchmark", "benchmark"),
)


def pair_run(pair: Pair, source: Path, times: int, seed: int) -> tuple[int, list[str]]:
    """Start two commands at once in one folder; return how often, and what went wrong."""
    rng, found = random.Random(seed), commands()
    both = [found[pair.first], found[pair.second]]
    faults: list[str] = []
    good = {0, 1} if "validate" in pair else {0}  # 1: it has found faults
    with copied(source) as folder:
        seconds = [_timed(command, folder) for command in both]
        expected = contents(folder, both[0]) | contents(folder, both[1])
        there = listing(folder)
        half = run(found[pair.before], folder).operations // 2 if pair.before else 0
    for _ in range(times):
        with copied(source) as folder:
            if pair.before:
                run(found[pair.before], folder, kill_at=max(half, 1))
            first = start(both[0], folder)
            time.sleep(rng.uniform(0, 0.5 * min(seconds)))
            second = start(both[1], folder)
            ends = [finish(*first), finish(*second)]
            faults += _wrong(ends, good)
            made: dict[str, bytes] = {}
            for command, end in zip(both, ends, strict=True):
                if end.code not in good and not pair.free:  # refused beside the other: afterwards it is done
                    end = run(command, folder)
                made |= contents(folder, command) if end.code in good else {}
            odd = sorted(path for path in made if made[path] != expected.get(path))
            if odd and not pair.free:
                faults.append(f"another result: {odd[:3]}")
            new = sorted(listing(folder) - there)
            if left := [path for path in new if "partial" in path or "lock" in path or not pair.free]:
                faults.append(f"left over: {left[:3]}")
    return times, faults


def _timed(command: Command, folder: Path) -> float:
    began = time.monotonic()
    run(command, folder)
    return time.monotonic() - began


def _wrong(ends: list[Ended], good: set[int]) -> list[str]:
    faults = []
    if not any(end.code in good for end in ends):
        faults.append(f"neither ended well: {ends[0].said[-200:]} {ends[1].said[-200:]}")
    for end in ends:
        if end.code not in (*good, 2):
            faults.append(f"ended with {end.code}: {end.said[-500:]}")
        if "Traceback" in end.said:
            faults.append(end.said[-500:])
        if end.code == 2 and end.said.count("error: ") != 1:
            faults.append(f"not one sentence: {end.said[-500:]}")
    return faults
