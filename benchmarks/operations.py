"""Which operations of a rollout take the time: a profile of the compiled program.

    python benchmarks/operations.py [--vertices 9352] [--uv 128] [--rank 0] [--clip CLIP.h5] [--top 5]
        [--json FILE]

jax.profiler's trace of compiled chunks, its events summed by operation. An operation is named by XLA and by
the line of the network that made it. Operations on several threads overlap: shares are of all threads' time.
"""

import argparse
import gzip
import json
import re
import tempfile
from collections import defaultdict
from pathlib import Path

import jax
from measured import report
from pipeline_speed import CHUNK
from sized import dressed, make_case, sized_config

from garment_jax.model.scan import make_rollout

ROUNDS = 4
FRAMING = ("jit(run)", "while", "body", "closed_call")  # of every operation's name
METADATA = re.compile(r"%?([\w.\-]+) = .*metadata=\{op_name=\"([^\"]*)\"")


def made_by(text: str) -> dict[str, str]:
    """Return the network's name for every operation of a compiled program `text`."""
    return dict(METADATA.findall(text))


def summed(trace: dict, names: dict[str, str]) -> list[dict]:
    """Return the profile's operations by time, longest first: XLA's name, who made it, microseconds."""
    total: dict[str, float] = defaultdict(float)
    for event in trace["traceEvents"]:
        operation = (event.get("args") or {}).get("hlo_op")
        # calls and loops hold the operations inside them
        if operation and not operation.startswith(("while", "call", "conditional")):
            total[operation] += event["dur"]
    longest = sorted(total.items(), key=lambda item: -item[1])
    return [{"operation": name, "made by": _short(names.get(name, "")), "us": us} for name, us in longest]


def _short(name: str) -> str:
    return "/".join(
        part for part in name.split("/") if part not in ("jit(run)", "while", "body", "closed_call")
    )


def traced(folder: Path) -> dict:
    """Return the newest trace below `folder`."""
    newest = max(folder.rglob("*.trace.json.gz"), key=lambda path: path.stat().st_mtime)
    with gzip.open(newest, "rt", encoding="utf-8") as file:
        return json.load(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vertices", type=int, default=9352)
    parser.add_argument("--uv", type=int, default=128)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--clip", type=Path)
    parser.add_argument("--top", type=int, default=5)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    scene, motion = dressed(options.clip, CHUNK)
    config = sized_config(options.uv, rank=options.rank)
    case = make_case(scene, motion, vertices=options.vertices, config=config)
    run = make_rollout(case.template, config)
    x = jax.tree.map(lambda leaf: leaf[:CHUNK], case.x)
    compiled = run.lower(case.params, case.start, x).compile()  # type: ignore[attr-defined]
    jax.block_until_ready(compiled(case.params, case.start, x))
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            for _ in range(ROUNDS):
                jax.block_until_ready(compiled(case.params, case.start, x))
        rows = summed(traced(Path(folder)), made_by(compiled.as_text()))
    whole = sum(row["us"] for row in rows)
    rows = [
        {
            "operation": row["operation"],
            "made by": row["made by"],
            "ms a frame": row["us"] / 1e3 / ROUNDS / CHUNK,
            "share %": 100 * row["us"] / whole,
        }
        for row in rows[: options.top]
    ]
    facts = {"vertices": len(case.template.T), "UV": options.uv, "rank": options.rank or "whole"}
    facts["all operations ms a frame"] = whole / 1e3 / ROUNDS / CHUNK
    report(rows, title="Longest operations of the networks", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
