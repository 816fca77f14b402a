"""The memory that animating a file takes, by its length: it must not grow with it.

    python benchmarks/animate_memory.py MODEL CLIP [--frames 2000 200000] [--no-collision] [--json FILE]

The clip's motion is repeated, its seam blended over 15 frames, and written as a motion. Each length is
animated by `infer.py` in a process of its own; the row holds the most that it held. The first length is
animated once before: a first run compiles, which takes more than all else.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from garment_jax.bench.figures import report
from garment_jax.body.looped_motion import looped_motion
from garment_jax.io.sequence import SequenceWriter, open_sequence

INFER = Path(__file__).parents[1] / "infer.py"


def animated(model: str, motion: Path, out: Path, *options: str) -> dict[str, float]:
    """Run `infer.py`; return its seconds and the most megabytes that it held."""
    began = time.perf_counter()
    command = [sys.executable, str(INFER), model, "--motion", str(motion), "--out", str(out), *options]
    child = subprocess.Popen(command)
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode:
        raise SystemExit(f"{' '.join(command)} ended with {child.returncode}")
    return {"seconds": time.perf_counter() - began, "peak MB": usage.ru_maxrss * 1024 / 1e6}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("clip")
    parser.add_argument("--frames", type=int, nargs="+", default=[2_000, 200_000])
    parser.add_argument("--no-collision", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    without = ["--no-collision"] if options.no_collision else []
    with open_sequence(options.clip) as sequence:
        scene, motion, name = sequence.scene, sequence.motion, sequence.name
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for frames in [options.frames[0], *options.frames]:
            clip, out = Path(folder) / "motion.h5", Path(folder) / "out.h5"
            with SequenceWriter(clip, scene, looped_motion(motion, frames), encoding="none"):
                pass
            rows.append({"frames": frames, **animated(options.model, clip, out, *without)})
            out.unlink()
    rows = rows[1:]
    grown = rows[-1]["peak MB"] - rows[0]["peak MB"]
    facts = {"model": options.model, "clip": name, "grown MB": round(grown, 1)}
    report(rows, title="Memory by length", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
