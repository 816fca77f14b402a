"""Milliseconds a frame of many clips simulated side by side, and how far they are from the clips themselves.

    python benchmarks/side_by_side.py CLIP... --pattern FLAT --cloth KEY=VALUE ... [--device cuda]

CLIPs are simulated again, by turns as many as `--at-once`, their first `--frames`. "clip" is the time that a
frame of one clip takes when all are done; it includes the frames before a clip's first, not the building of
tables and trees. Differences are root mean squares over vertices, cm, at the last of the frames, of the clip
that differs most: from the clip, and of a clip from itself, simulated in another place of the same call.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from garment_jax.bench.figures import report
from garment_jax.io.sequence import open_sequence
from garment_jax.simulation.command import cloth_settings, read_pattern
from garment_jax.simulation.newton_cloth import drape
from garment_jax.simulation.side_by_side import SideBySide
from garment_jax.structs import Motion, Scene


def read(paths: list[Path], frames: int) -> tuple[Scene, list[Motion], list[np.ndarray]]:
    """Return the scene, and the first frames of the clips: motions and cloths."""
    scene, motions, truth = None, [], []
    for path in paths:
        with open_sequence(path) as clip:
            scene, motion = clip.scene, clip.motion
            motions.append(Motion(motion.rotations[:frames], motion.root[:frames], motion.fps))
            truth.append(clip.read(0, len(motions[-1].root)))
    assert scene is not None
    return scene, motions, truth


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """Return the RMSE over vertices of the last frame, cm."""
    return 100.0 * float(np.sqrt(np.square(a[-1] - b[-1]).sum(axis=-1).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clips", nargs="+", type=Path)
    parser.add_argument("--pattern", type=Path)
    parser.add_argument("--cloth", nargs="*", default=[])
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--at-once", nargs="+", type=int, default=[1, 16, 128])
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    scene, motions, truth = read(options.clips, options.frames)
    draped = drape(scene, settings, flat=flat)
    rows = []
    for count in options.at_once:
        which = np.arange(count) % len(motions)
        began = time.perf_counter()
        cloths = SideBySide(scene, settings, flat, count, options.device)
        cloths.simulate([motions[i] for i in which[:1]], drape=draped)  # loads and records all that there is
        built = time.perf_counter() - began
        stamps: list[float] = []
        V = cloths.simulate(
            [motions[i] for i in which],
            drape=draped,
            progress=lambda done, total, stamps=stamps: stamps.append(time.perf_counter()),
        )
        frame = 1e3 * float(np.median(np.diff(stamps)))
        twins = [apart(V[i], V[i % len(motions)]) for i in range(len(motions), count)]
        rows.append(
            {
                "clips": count,
                "frame ms": frame,
                "clip ms": frame / count,
                "frames/s": 1e3 * count / frame,
                "first call s": built,
                "from the clips cm": max(apart(V[i], truth[which[i]]) for i in range(count)),
                "from its twin cm": max(twins, default=0.0),
            }
        )
        print(rows[-1], flush=True)
    facts = {"device": cloths.device_name, "frames": options.frames, "vertices": len(scene.garment.template)}
    report(rows, title="Simulated side by side", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
