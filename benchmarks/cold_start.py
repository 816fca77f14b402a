"""Seconds from the start of `infer.py` to its first frames: without any cache, and with what that start kept.

    python benchmarks/cold_start.py models/skirt CLIP [--collision] [--json FILE]

A fresh interpreter each time, Python's own bytecode in place (the first start of all writes it and is not
reported). The clock runs from the process' start to the first line of progress, which comes after the first
chunk of frames has been written.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from garment_jax.bench.figures import report

ROOT = Path(__file__).parents[1]


def first_frames(words: list[str], cache: str) -> float:
    """Return the seconds until the first chunk; the rest of the motion is not waited for."""
    command = [sys.executable, str(ROOT / "infer.py"), *words]
    settings, quiet = {**os.environ, "GARMENT_JAX_CACHE": cache}, subprocess.DEVNULL
    # importing jax here has set it: with it XLA writes pages about each kept program, all to be read below
    settings.pop("TF_CPP_MIN_LOG_LEVEL", None)
    began = time.perf_counter()
    shown, terminal = os.openpty()  # elsewhere than on a terminal progress is a line now and then
    process = subprocess.Popen(command, stderr=terminal, stdout=quiet, env=settings)
    os.close(terminal)
    seconds, said = 0.0, b""
    with suppress(OSError):  # a terminal's end, as Linux has it
        while piece := os.read(shown, 4096):  # to its end, so that what it keeps is whole
            said += piece
            if not seconds and b" frames/s" in said:
                seconds = time.perf_counter() - began
    if process.wait() or not seconds:
        raise ValueError(f"infer.py stopped: {said.decode()}")
    return seconds


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("clip")
    parser.add_argument("--collision", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        words = [options.model, "--motion", options.clip, "--out", f"{folder}/out.h5", "--force"]
        words += [] if options.collision else ["--no-collision"]
        subprocess.run([sys.executable, str(ROOT / "infer.py"), "--help"], capture_output=True, check=True)
        code = "import garment_jax.cli.infer, garment_jax.animation.animate"
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
        for name in ("nothing kept", "second start", "third start"):
            rows.append({"start": name, "first frames s": first_frames(words, f"{folder}/cache")})
    facts = {"collision": options.collision, "model": options.model}
    report(rows, title="Cold start of infer.py", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
