"""Seconds from the start of `garment-jax animate` to its frames: without any cache, and with what that kept.

    python benchmarks/cold_start.py [models/skirt] [--json FILE]

A fresh interpreter each time, Python's own bytecode in place (the first start of all writes it and is not
reported). The clock runs from the process' start. "seen": a page is opened in the browser (a script in its
place notes the time), with an empty cache one of the first frames before contact handling; "finished frames":
the first line of progress, after a chunk of frames has been written; "finished page": the end.
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
BROWSER = "import pathlib, time; pathlib.Path('{}').open('a').write(f'{{time.time()}}\\n')"


def started(model: str, folder: Path) -> dict[str, float]:
    """Return the seconds until frames are seen, until the first are finished, and until the page is."""
    (folder / "browser.py").write_text(BROWSER.format(folder / "seen"))
    settings = {**os.environ, "GARMENT_JAX_CACHE": str(folder / "cache"), "DISPLAY": ":0"}
    settings |= {"BROWSER": f"{sys.executable} {folder / 'browser.py'} %s", "PYTHONPATH": str(ROOT)}
    # importing jax here has set it: with it XLA writes pages about each kept program, all to be read below
    settings.pop("TF_CPP_MIN_LOG_LEVEL", None)
    (folder / "seen").unlink(missing_ok=True)
    command = [sys.executable, "-m", "garment_jax", "animate", model, "--force"]
    began, clock = time.time(), time.perf_counter()
    shown, terminal = os.openpty()  # elsewhere than on a terminal progress is a line now and then
    process = subprocess.Popen(command, stderr=terminal, stdout=subprocess.DEVNULL, env=settings, cwd=folder)
    os.close(terminal)
    seconds, said = 0.0, b""
    with suppress(OSError):  # a terminal's end, as Linux has it
        while piece := os.read(shown, 4096):
            said += piece
            if not seconds and b" frames/s" in said:
                seconds = time.perf_counter() - clock
    if process.wait() or not seconds:
        raise ValueError(f"animate stopped: {said.decode()}")
    seen = float((folder / "seen").read_text().split()[0]) - began
    return {"seen s": seen, "finished frames s": seconds, "finished page s": time.perf_counter() - clock}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", default=str(ROOT / "models" / "skirt"))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        code = "import garment_jax.api.animating, garment_jax.animation.animate, garment_jax.viewer.command"
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
        model = str(Path(options.model).resolve())
        for start in ("nothing kept", "second start", "third start"):
            rows.append({"start": start} | started(model, Path(name)))
            print(rows[-1], flush=True)
    facts = {"model": Path(options.model).name}
    report(rows, title="Start of garment-jax animate", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
