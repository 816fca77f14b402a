"""A rollout of looped dance, 10,000 frames or more: does it stay bounded, finite, small and fast?

    python benchmarks/long_rollout.py MODEL CLIP [--frames 10000] [--no-detail] [--collision] [--json FILE]

The clip is repeated, its seam blended over 15 frames. Frames are streamed; nothing is kept but the figures.
Reach is the largest distance of a vertex from the root joint, the hem is the loop of the garment's border
that hangs lowest on the template. Memory growth counts from the end of the first chunk, when everything is
compiled, and from before the motion's inputs were computed.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.animation.animate import animate
from garment_jax.bench.figures import report
from garment_jax.body.looped_motion import looped_motion
from garment_jax.geometry.boundary import hem_vertices
from garment_jax.io.sequence import open_sequence
from garment_jax.machine import peak_mb, resident_mb
from garment_jax.training.pipeline import trained_model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("clip")
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--chunk", type=int, default=256)
    parser.add_argument("--no-detail", action="store_true")
    parser.add_argument("--collision", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model = trained_model(options.model)
    model = model._replace(
        config=replace(model.config, rollout=replace(model.config.rollout, chunk=options.chunk))
    )
    with open_sequence(options.clip) as sequence:
        scene, motion, name = sequence.scene, sequence.motion, sequence.name
        truth = max(float(np.abs(V - motion.root[s : s + len(V), None]).max()) for s, V in sequence.windows())
    garment = scene.garment
    hem = hem_vertices(garment.template, garment.faces, None if scene.pins is None else scene.pins.vertices)
    whole = looped_motion(motion, options.frames)
    before = resident_mb()
    rows, done, after_first = [], 0, 0.0
    began = time.perf_counter()
    for piece in animate(model, scene, whole, detail=not options.no_detail, collision=options.collision):
        V = piece.V - whole.root[done : done + len(piece.V), None]
        height = V[:, hem, 1].mean(axis=1)
        rows.append(
            {
                "frames": f"{done}-{done + len(V)}",
                "finite": bool(np.isfinite(V).all()),
                "reach m": float(np.linalg.norm(V, axis=-1).max()),
                "hem low m": float(height.min()),
                "hem high m": float(height.max()),
                "ms/frame": 1e3 * (time.perf_counter() - began) / len(V),
                "memory MB": resident_mb(),
            }
        )
        done += len(V)
        after_first = after_first or resident_mb()
        began = time.perf_counter()
    facts = {
        "model": options.model,
        "clip": name,
        "frames": done,
        "seams": options.frames // (len(motion.root) - 15),
        "finite": all(row["finite"] for row in rows),
        "reach m": max(row["reach m"] for row in rows),
        "largest coordinate in the clip's truth m": truth,
        "hem m": [round(min(r["hem low m"] for r in rows), 3), round(max(r["hem high m"] for r in rows), 3)],
        "growth after the first chunk MB": round(resident_mb() - after_first),
        "growth in all MB": round(resident_mb() - before),
        "peak MB": round(peak_mb()),
    }
    shown = rows[:3] + rows[3:-2][:: max(len(rows) // 8, 1)] + rows[-2:] if len(rows) > 12 else rows
    report(shown, title="A long rollout", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
