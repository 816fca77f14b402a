"""Does a garment come to rest when its body stands still? Simulated, of the networks, and of infer.py.

    python benchmarks/held_pose.py MODEL CLIP[@FRAME]... [--frames 300] [--no-simulation] [--pattern FLAT.npz]

Each clip up to FRAME (the last two seconds of it), whose pose is then held; by default the frame in which
hips or knees bend most, as in the stability report. "N s": how far the vertices move
a frame N seconds after the body has stopped, mm, mean of half a second: root mean square over the vertices,
and in brackets the fastest one. "creep": RMSE between the garments 3 s after and at the end, cm.
"""

import argparse
from pathlib import Path

import numpy as np

from garment_jax.animation.animate import animate
from garment_jax.bench.figures import report
from garment_jax.body.root_frame import heading, to_root
from garment_jax.body.vary import LEGS
from garment_jax.io.sequence import open_sequence
from garment_jax.model.store import Model, load_model
from garment_jax.progress import FrameProgress
from garment_jax.simulation.command import cloth_settings, read_pattern
from garment_jax.simulation.newton_cloth import drape, simulate_frames
from garment_jax.stability.subject import relative_angles
from garment_jax.structs import Motion, Scene

LEAD = 2.0  # seconds of motion before the held pose
TIMES = (0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 9.0)  # seconds
WINDOW, SETTLED = 0.5, 3.0  # seconds


def read(place: str, frames: int) -> tuple[str, Scene, Motion, int]:
    """Return the pose's name, the scene, the motion into the held pose, and its first held frame."""
    path, _, frame = place.partition("@")
    with open_sequence(Path(path)) as clip:
        scene, motion = clip.scene, clip.motion
    legs = [scene.body.joint_names.index(name) for name in LEGS]
    bent = relative_angles(motion, scene.body.parents, np.array(legs)).max(axis=1)
    stop = int(frame or bent.argmax())
    lead = slice(max(0, stop - round(LEAD * motion.fps)), stop)

    def held(x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[lead], np.repeat(x[stop : stop + 1], frames, axis=0)])

    name = f"{Path(path).stem}@{stop}"
    return name, scene, Motion(held(motion.rotations), held(motion.root), motion.fps), lead.stop - lead.start


def simulated(scene: Scene, motion: Motion, options: argparse.Namespace) -> np.ndarray:
    """Return the cloth of every frame, `[t, n, 3]` metres, world."""
    settings = cloth_settings(options.cloth)
    flat = None if options.pattern is None else read_pattern(options.pattern)
    with FrameProgress("drape") as progress:
        start = drape(scene, settings, flat=flat, progress=progress)
    with FrameProgress("held pose") as progress:
        frames = simulate_frames(scene, motion, settings, drape=start, flat=flat, progress=progress)
        return np.stack(list(frames))


def predicted(model: Model, scene: Scene, motion: Motion, *, collision: bool) -> np.ndarray:
    """Return the same of a model, with and without collision handling."""
    return np.concatenate([chunk.V for chunk in animate(model, scene, motion, collision=collision)])


def row(place: str, what: str, V: np.ndarray, motion: Motion, first: int) -> dict:
    """Return the movements of one garment; `V` `[t, n, 3]` metres, world; held from frame `first`."""
    V = to_root(V.astype(np.float64), motion.root, heading(motion.rotations[:, 0]))[first:]
    step = 1e3 * np.sqrt(np.square(V[1:] - V[:-1]).sum(axis=-1))  # [t - 1, n] mm
    rms, fastest = np.sqrt(np.square(step).mean(axis=1)), step.max(axis=1)
    cells = {"clip": place, "garment": what}
    for time in TIMES:
        window = slice(round(time * motion.fps), round((time + WINDOW) * motion.fps))
        if window.stop <= len(rms):
            cells[f"{time:g} s"] = f"{rms[window].mean():.2f} ({fastest[window].mean():.1f})"
    creep = V[-1] - V[min(round(SETTLED * motion.fps), len(V) - 1)]
    return {**cells, "creep cm": 100.0 * float(np.sqrt(np.square(creep).sum(axis=-1).mean()))}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("places", nargs="+", metavar="CLIP[@FRAME]")
    parser.add_argument("--frames", type=int, default=300, help="that the pose is held")
    parser.add_argument("--no-simulation", action="store_true")
    parser.add_argument("--pattern", type=Path, help="flat pattern in metres, as the clips' own")
    parser.add_argument("--cloth", nargs="*", default=[], metavar="KEY=VALUE", help="as the clips' own")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model, rows = load_model(options.model), []
    for asked in options.places:
        place, scene, motion, first = read(asked, options.frames)
        if not options.no_simulation:
            rows.append(row(place, "simulated", simulated(scene, motion, options), motion, first))
        for what, collision in (("without collisions", False), ("predicted", True)):
            V = predicted(model, scene, motion, collision=collision)
            rows.append(row(place, what, V, motion, first))
    facts = {"model": str(options.model), "frames held": options.frames}
    report(rows, title="Movement a frame while the pose is held, mm", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
