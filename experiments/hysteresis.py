"""How far does simulated cloth hang from where it hung before, in the same calm pose after some motion?

    python experiments/hysteresis.py CLIP... [--frames 300] [--pattern FILE] [--cloth KEY=VALUE ...]

Cloth has a memory: friction and folds keep it off the garment that the same pose, reached slowly, would
have. The script of `garment-jax stability` (the calm pose reached slowly; then each clip, blended into the
calm pose, which is held for 90 frames) goes through the cloth engine. Compared with the last frame of the
calm pose reached slowly: RMSE and the hem's mean height 60 frames after each clip, at most from then on, and
how far the garment still moves in the last 30 frames. `NORMAL` of `stability/extreme.py` comes from here.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from garment_jax.bench.figures import report
from garment_jax.body.root_frame import heading, to_root
from garment_jax.evaluation.cloth import rest_lengths
from garment_jax.geometry.boundary import hem_vertices
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import open_sequence
from garment_jax.progress import FrameProgress
from garment_jax.simulation.command import cloth_settings, read_pattern
from garment_jax.simulation.newton_cloth import drape, simulate_frames
from garment_jax.stability.extreme import RECOVERED, garment_length, signed_strain
from garment_jax.stability.extreme_motions import calmest_pose
from garment_jax.stability.script import Part, make_script
from garment_jax.structs import Garment, Motion, Scene


def read(paths: list[Path], frames: int) -> tuple[Scene, list[tuple[str, Motion]]]:
    """Return the scene and the middle `frames` frames of every clip."""
    motions = []
    for path in paths:
        with open_sequence(path) as clip:
            scene, motion = clip.scene, clip.motion
        start = max((len(motion.root) - frames) // 2, 0)
        window = slice(start, start + frames)
        motions.append((path.stem, Motion(motion.rotations[window], motion.root[window], motion.fps)))
    return scene, motions


def rmse_cm(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return 100.0 * np.sqrt(np.square(a - b).sum(axis=-1).mean(axis=-1))


def row(part: Part, V: np.ndarray, before: np.ndarray, garment: Garment, hem: np.ndarray) -> dict:
    """Return the figures of one part; `before` is the garment of the calm pose reached slowly."""
    held = V[part.calm + RECOVERED : part.end].astype(np.float64)
    apart = rmse_cm(held, before[None])
    rise = 100.0 * (held[:, hem, 1].mean(axis=1) - before[hem, 1].mean())
    edges = unique_edges(garment.faces)
    stretch = signed_strain(V[part.start : part.end], edges, rest_lengths(garment.template, edges))
    return {
        "after": part.name,
        "frames": part.stop - part.start,
        "apart cm": float(apart[0]),
        "at most cm": float(apart.max()),
        "of its length": float(apart.max()) / 100.0 / garment_length(garment),
        "hem cm": float(rise[np.abs(rise).argmax()]),
        "still moving cm": float(rmse_cm(held[:1], held[-1:])[0]),
        "stretch p99 %": float(np.percentile(np.maximum(stretch, 0.0), 99, axis=1).max()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("clips", nargs="+", type=Path)
    parser.add_argument("--frames", type=int, default=300, help="of each clip, from its middle")
    parser.add_argument("--pattern", type=Path, help="flat pattern in metres, as the clips' own")
    parser.add_argument("--cloth", nargs="*", default=[], metavar="KEY=VALUE", help="as the clips' own")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path, help="write the simulated vertices, root frame (.npy)")
    options = parser.parse_args()
    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    scene, motions = read(options.clips, options.frames)
    garment = scene.garment
    motion, places = make_script(calmest_pose(tuple(motions), scene.body), motions)
    began = time.perf_counter()
    with FrameProgress("drape") as progress:
        draped = drape(scene, settings, flat=flat, progress=progress)
    with FrameProgress("script") as progress:
        frames = simulate_frames(scene, motion, settings, drape=draped, flat=flat, progress=progress)
        world = np.stack([np.asarray(frame, np.float32) for frame in frames])
    V = to_root(world.astype(np.float64), motion.root, heading(motion.rotations[:, 0])).astype(np.float32)
    if options.keep is not None:
        np.save(options.keep, V)
    pins = None if scene.pins is None else scene.pins.vertices
    hem = hem_vertices(garment.template, garment.faces, pins)
    before = V[places[0].end - 1].astype(np.float64)
    rows = [row(part, V, before, garment, hem) for part in places[1:]]
    facts = {
        "frames": len(V),
        "seconds": round(time.perf_counter() - began),
        "garment's length m": garment_length(garment),
        "largest cm": max(r["at most cm"] for r in rows),
        "largest of its length": max(r["of its length"] for r in rows),
        "largest hem cm": max(abs(r["hem cm"]) for r in rows),
    }
    report(rows, title="Where cloth hangs after a motion", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
