"""What moving a motion by 100 m and turning it by 137 degrees changes of the garment, in its root frame.

    python benchmarks/moved.py MODEL CLIP... [--json FILE]

Each clip is animated as it is and moved and turned, without and with collision handling. Nothing should
change; what does is the rounding of the turned rotations to float32, and what magnifies it.
"""

import argparse
from pathlib import Path

import numpy as np

from garment_jax.animation.animate import animate
from garment_jax.bench.figures import report
from garment_jax.body.root_frame import heading, to_root, yaw_matrix
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import load_model
from garment_jax.structs import Motion

WAY = np.array([60.0, 0.0, -80.0])  # metres
TURN = yaw_matrix(np.array(np.radians(137.0)))
BOUND_MM = 0.1


def moved(motion: Motion) -> Motion:
    """Return the motion elsewhere, in its own types."""
    rotations = (TURN @ motion.rotations.astype(np.float64)).astype(motion.rotations.dtype)
    return Motion(rotations, motion.root @ TURN.T + WAY, motion.fps)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("clips", nargs="+")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model, rows = load_model(options.model), []
    for path in options.clips:
        with open_sequence(path) as clip:
            scene, name, motions = clip.scene, clip.name, (clip.motion, moved(clip.motion))
        for collision in (False, True):
            garments = []
            for motion in motions:
                pieces = [piece.V for piece in animate(model, scene, motion, collision=collision)]
                V, yaw = np.concatenate(pieces).astype(np.float64), heading(motion.rotations[:, 0])
                garments.append(to_root(V, motion.root.astype(np.float64), yaw))
            apart = 1e3 * np.linalg.norm(garments[1] - garments[0], axis=-1)
            rows.append(
                {
                    "clip": name,
                    "frames": len(apart),
                    "collision": collision,
                    "rms mm": float(np.sqrt(np.square(apart).mean())),
                    "at most mm": float(apart.max()),
                    f"frames above {BOUND_MM:g} mm": int((apart.max(axis=1) > BOUND_MM).sum()),
                }
            )
    title = "Moved by 100 m and turned by 137 degrees"
    report(rows, title=title, facts={"model": options.model}, json_path=options.json)


if __name__ == "__main__":
    main()
