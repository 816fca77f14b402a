"""Seconds a frame of the cloth simulation, one process, with and without self-collision.

    python benchmarks/simulation_speed.py [CLIP] [--frames 20] [--json FILE]

On the embedded skirt's walk, and on the scene and motion of CLIP, a sequence file. Medians over frames;
building the model, the drape and what goes before a clip's first frame do not count.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from measured import report

from garment_jax.data.sequence import open_sequence
from garment_jax.embedded.motions import make_motion
from garment_jax.embedded.scene import make_outfit
from garment_jax.simulation.newton_cloth import drape, simulate_frames
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion, Scene


def seconds_a_frame(scene: Scene, motion: Motion, flat: np.ndarray | None, settings: ClothSettings) -> float:
    """Return the median time between frames after the first."""
    draped = drape(scene, replace(settings, settle=2), flat=flat)
    times = [time.perf_counter()]
    for _ in simulate_frames(scene, motion, settings, drape=draped, flat=flat):
        times.append(time.perf_counter())
    return float(np.median(np.diff(times)[1:]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", nargs="?", type=Path)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    scene, flat = make_outfit("skirt")
    cases = [("embedded skirt", scene, make_motion("walk", scene.body, seconds=options.frames / 30), flat)]
    if options.clip is not None:
        with open_sequence(options.clip) as clip:
            motion = Motion(
                clip.motion.rotations[: options.frames], clip.motion.root[: options.frames], clip.fps
            )
            cases.append((clip.name, clip.scene, motion, None))
    rows = []
    for name, scene, motion, flat in cases:
        row: dict = {"scene": name, "vertices": len(scene.garment.template)}
        for title, on in (("s/frame", False), ("s/frame, self-collision", True)):
            settings = ClothSettings(blend=2, hold=2, self_collision=on)
            row[title] = seconds_a_frame(scene, motion, flat, settings)
        rows.append(row)
    report(rows, title="Cloth simulation", facts={"frames": options.frames}, json_path=options.json)


if __name__ == "__main__":
    main()
