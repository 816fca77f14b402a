"""What self-collision changes in simulated cloth: crossings, time a frame, and how long it can be known.

    python experiments/self_contact_truth.py CLIP --pattern FLAT --cloth bend_bias=0.5 settle=1 --out sims
    python experiments/self_contact_truth.py --garment cape --motion twirl --out sims

A clip's motion, or an embedded garment on one of its own motions, is simulated with and without
self-collision, each a second time from a drape that lies a millimetre aside. Edges through faces and cloth on
the other side in every tenth frame; "known": frames before the two are more than 0.5 cm apart (RMSE). The
four simulations stay in `--out`, for `garment-jax render` and `view`.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from garment_jax.bench.figures import report
from garment_jax.evaluation.determined import determined_frames
from garment_jax.evaluation.rmse import rmse_per_frame
from garment_jax.evaluation.self_intersections import self_intersections
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.procedural.motions import make_motion
from garment_jax.procedural.scene import make_scene
from garment_jax.progress import FrameProgress
from garment_jax.simulation.command import cloth_settings, read_pattern
from garment_jax.simulation.newton_cloth import drape, simulate_frames
from garment_jax.structs import Motion, Scene

ASIDE = 1e-3  # metres
EVERY = 10  # frames, of those that are counted


def subject(options: argparse.Namespace) -> tuple[str, Scene, Motion]:
    """Return the name, the garment on its body, and the motion."""
    if options.clip is None:
        scene = make_scene(options.garment, vertices=options.vertices)
        motion = make_motion(options.motion, scene.body, seconds=options.seconds)
        return f"{options.garment}_{options.motion}", scene, motion
    with open_sequence(options.clip) as clip:
        return clip.name, clip.scene, clip.motion


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("clip", type=Path, nargs="?")
    parser.add_argument("--garment", default="cape")
    parser.add_argument("--motion", default="twirl")
    parser.add_argument("--vertices", type=int, default=900)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--frames", type=int, default=10_000, help="at most")
    parser.add_argument("--pattern", type=Path)
    parser.add_argument("--cloth", nargs="*", default=[])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    name, scene, motion = subject(options)
    motion = Motion(motion.rotations[: options.frames], motion.root[: options.frames], motion.fps)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    edges, faces = unique_edges(scene.garment.faces), scene.garment.faces
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for contact in (False, True):
        settings = replace(cloth_settings(options.cloth), self_collision=contact, fps=motion.fps)
        draped, runs = drape(scene, settings, flat=flat), []
        began = time.perf_counter()
        for aside in (0.0, ASIDE):
            start = draped._replace(positions=draped.positions + np.float32([aside, 0.0, 0.0]))
            what = f"{name}_{'with' if contact else 'without'}{'_again' if aside else ''}"
            with FrameProgress(what) as progress:
                frames = simulate_frames(scene, motion, settings, drape=start, flat=flat, progress=progress)
                runs.append(np.stack([np.asarray(frame, np.float32) for frame in frames]))
            kind = {"kind": "simulated", "name": what}
            with SequenceWriter(options.out / f"{what}.h5", scene, motion, attributes=kind) as writer:
                writer.append(runs[-1])
        took = time.perf_counter() - began
        itself = [self_intersections(V, faces, edges) for V in runs[0][::EVERY]]
        apart = rmse_per_frame(*runs)
        count = np.array([each.edges for each in itself])
        rows.append(
            {
                "self-collision": "on" if contact else "off",
                "s/frame": took / (2 * len(motion.root)),
                "edges through faces": float(count.mean()),
                "at most": int(count.max()),
                "frames with none %": 100.0 * float((count == 0).mean()),
                "other side cm2": float(np.mean([each.area_cm2 for each in itself])),
                "known frames": determined_frames(apart),
                "of": len(apart),
                "apart at the end cm": float(apart[-1]),
            }
        )
    facts = {"subject": name, "vertices": len(scene.garment.template), "cloth": " ".join(options.cloth)}
    report(rows, title="simulated cloth with and without self-collision", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
