"""How well can a clip be predicted by who does not know from where the body turned to its first heading?

    python experiments/unknown_turn.py CLIP... --pattern FLAT --cloth KEY=VALUE ... [--turns 8] [--keep DIR]

The simulator puts the garment on a body that faces +Z, and turns it to the clip's first heading before frame
0 (`turn_in=on`). A model that must not know where the body looks cannot know that turn, and folds remember
it. Each CLIP is simulated again with `--turns` - 1 other turns, evenly spread (the whole motion is turned,
and the cloth back). RMSE in cm over vertices and frames: "own turn" is the clip simulated again as it was,
"others" the mean of a single other one, "mean of others" their mean frame by frame, the best guess without
the turn, and "without the turn" that divided by sqrt(1 + 1 / (turns - 1)), as of infinitely many. The last
columns are the clip's first and last third, by that guess, and its drift as `garment-jax evaluate` has it.
`--keep` makes it resumable: a folder of one cloth and pattern, a file a simulation.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from garment_jax.bench.figures import report
from garment_jax.body.root_frame import yaw_matrix
from garment_jax.evaluation.drift import drift, skinned_template, skinning_weights
from garment_jax.evaluation.rmse import rmse_per_frame
from garment_jax.io.sequence import open_sequence
from garment_jax.storage.whole import replaced
from garment_jax.structs import Motion


def again(path: Path, angle: float, options: argparse.Namespace) -> np.ndarray:
    """Return the cloth `[t, n, 3]` of the clip turned by `angle` degrees while simulated, and back."""
    from garment_jax.simulation.command import cloth_settings, read_pattern
    from garment_jax.simulation.newton_cloth import drape, simulate_frames

    kept = None if options.keep is None else options.keep / f"{path.stem}_{angle:g}.npy"
    if kept is not None and kept.is_file():
        return np.load(kept)
    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    with open_sequence(path) as clip:
        scene, motion = clip.scene, clip.motion
    turn = yaw_matrix(np.array(np.radians(angle)))
    root = motion.root.astype(np.float64) @ turn.T
    whole = Motion((turn @ motion.rotations).astype(motion.rotations.dtype), root, motion.fps)
    draped = drape(scene, settings, flat=flat)
    frames = simulate_frames(scene, whole, settings, drape=draped, flat=flat)
    V = np.stack([(x.astype(np.float64) @ turn).astype(np.float32) for x in frames])
    if kept is not None:
        with replaced(kept) as (made,):
            np.save(made, V)
    print(f"{path.stem}, turned by {angle:g} degrees: done", flush=True)
    return V


def judged(truth: np.ndarray, skinned: np.ndarray, runs: list[np.ndarray]) -> dict[str, float]:
    """Return the figures of a clip from `runs`, the first with its own turn; `skinned`: its template."""

    def rmse(V: np.ndarray, frames: slice = slice(None)) -> float:
        square = np.square((V - truth)[frames]).sum(axis=-1)
        return 100.0 * float(np.sqrt(square.mean(dtype=np.float64)))

    own, others = runs[0], runs[1:]
    guess = np.mean(others, axis=0, dtype=np.float64).astype(np.float32)
    many = 1.0 / np.sqrt(1.0 + 1.0 / len(others))
    third = max(len(truth) // 3, 1)
    return {
        "own turn": rmse(own),
        "others": float(np.mean([rmse(V) for V in others])),
        "mean of others": rmse(guess),
        "without the turn": many * rmse(guess),
        "first third": many * rmse(guess, slice(third)),
        "last third": many * rmse(guess, slice(-third, None)),
        "drift": drift(rmse_per_frame(guess, truth), rmse_per_frame(skinned, truth)),
    }


def main() -> None:
    """Simulate, print a table, write JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("clips", type=Path, nargs="+")
    parser.add_argument("--pattern", type=Path)
    parser.add_argument("--cloth", nargs="*", default=[])
    parser.add_argument("--turns", type=int, default=8)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.turns < 3:
        parser.error(f"--turns {options.turns} leaves no mean of others; give 3 at least, such as 8.")
    angles = [360.0 * k / options.turns for k in range(options.turns)]
    rows = []
    with ProcessPoolExecutor(options.workers) as pool:
        runs = {p: [pool.submit(again, p, angle, options) for angle in angles] for p in options.clips}
        for path, futures in runs.items():
            with open_sequence(path) as clip:
                truth, whole = clip.read(0, clip.frames), slice(0, clip.frames)
                skinned = skinned_template(clip.scene, clip.motion, skinning_weights(clip.scene), whole)
            found = [future.result() for future in futures]
            rows.append({"clip": path.stem, **judged(truth, skinned, found)})
    means = {key: float(np.mean([row[key] for row in rows])) for key in list(rows[0])[1:]}
    rows.append({"clip": "mean", **means})
    report(
        rows,
        title="Without the turn before the first frame",
        facts={"turns": options.turns, "cloth": " ".join(options.cloth)},
        json_path=options.json,
    )


if __name__ == "__main__":
    main()
