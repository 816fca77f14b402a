"""Seconds a frame of the cloth simulation, one process, with and without self-collision.

    python benchmarks/simulation_speed.py [CLIP] [--frames 20] [--vertices 9352 --uv 128] [--json FILE]

On the embedded skirt's walk, and on the scene and motion of CLIP, a sequence file. Medians over frames;
building the model, the drape and what goes before a clip's first frame do not count. With `--vertices` on
the last of them alone, its garment resampled, and beside the networks of that size (random parameters, as in
pipeline_speed.py) with detail and collision handling in the same run: how many times as fast they are.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from pipeline_speed import CHUNK, collision_samples, network_samples
from sized import dressed, make_case, predictions, sized_config

from garment_jax.bench.figures import report
from garment_jax.io.sequence import open_sequence
from garment_jax.procedural.motions import make_motion
from garment_jax.procedural.scene import make_outfit
from garment_jax.simulation.newton_cloth import drape, simulate_frames
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion, Scene

SIMULATED = 6  # frames of the comparison: each takes seconds
RADIUS = 2e-3  # metres, of self-collision at some 9,000 vertices


def seconds_a_frame(scene: Scene, motion: Motion, flat: np.ndarray | None, settings: ClothSettings) -> float:
    """Return the median time between frames after the first."""
    draped = drape(scene, replace(settings, settle=2), flat=flat)
    times = [time.perf_counter()]
    for _ in simulate_frames(scene, motion, settings, drape=draped, flat=flat):
        times.append(time.perf_counter())
    return float(np.median(np.diff(times)[1:]))


def against_networks(scene: Scene, motion: Motion, few: Motion, options: argparse.Namespace) -> list[dict]:
    """Return seconds a frame with and without self-collision, and the networks' of the same size."""
    predicted = None if options.clip is None else predictions(options.model, options.clip, options.frames)
    case = make_case(
        scene, motion, vertices=options.vertices, config=sized_config(options.uv), predicted=predicted
    )
    networks = float(np.median(network_samples(case)))
    collision = float(np.median(collision_samples(case, whole_body=False)[0]))
    rows = []
    for on in (False, True):
        settings = ClothSettings(blend=2, hold=2, self_collision=on, self_collision_radius=RADIUS)
        seconds = seconds_a_frame(case.scene, few, None, settings)
        rows.append(
            {
                "vertices": len(case.template.T),
                "self-collision": "on" if on else "off",
                "s/frame": seconds,
                "networks, detail ms": networks,
                "and collision ms": networks + collision,
                "times as fast": 1e3 * seconds / (networks + collision),
                "without collision": 1e3 * seconds / networks,
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", nargs="?", type=Path)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--vertices", type=int, default=0, help="resample, and compare with the networks")
    parser.add_argument("--uv", type=int, default=128)
    parser.add_argument("--model", type=Path, default=Path("models/skirt"), help="of CLIP's garment")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.vertices:
        options.frames = max(options.frames // CHUNK, 2) * CHUNK
        scene, motion = dressed(options.clip, options.frames)
        few = Motion(motion.rotations[:SIMULATED], motion.root[:SIMULATED], motion.fps)
        rows = against_networks(scene, motion, few, options)
        report(rows, title="Cloth simulation and networks", facts={}, json_path=options.json)
        return
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
