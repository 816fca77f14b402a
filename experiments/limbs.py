"""What putting cloth back on its side of a limb does and costs, on rollouts made without collision handling.

    python infer.py models/skirt --motion CLIP.h5 --no-lengths --no-collision --out raw/CLIP.h5
    python experiments/limbs.py raw data/skirt/test [--json FILE]

Each clip's error before and after (collision handling follows, and is not part of this); the frames in
which a bone runs through the cloth, beside the truth's; and milliseconds a frame of one compiled call:
"apart" where no vertex is near a bone, "near" where bones had to be tried, "pierced" where one was through.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.bench.figures import report
from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.body.limbs import limbs_of
from garment_jax.body.root_frame import heading, to_root
from garment_jax.evaluation.piercing import pierced_bones
from garment_jax.evaluation.rmse import rmse
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.geometry.strain_limit import make_strain_tables
from garment_jax.io.sequence import Sequence, open_sequence
from garment_jax.postprocess.limb_crossings import init_crossings, make_limb_crossing_tables, undo_crossings


def rooted(clip: Sequence) -> np.ndarray:
    """Return a clip's vertices `[t, n, 3]` in its root frames, metres."""
    yaw = heading(clip.motion.rotations[:, 0])
    V = to_root(clip.read(0, clip.frames).astype(np.float64), clip.motion.root.astype(np.float64), yaw)
    return V.astype(np.float32)


def measure(path: Path, truth: Path) -> dict[str, Any]:
    """Return one clip's row."""
    with open_sequence(path) as clip, open_sequence(truth) as true:
        scene, motion, name, V, V_star = clip.scene, clip.motion, clip.name, rooted(clip), rooted(true)
    assert scene.collider is not None
    assert scene.pins is not None
    T, faces, pins = scene.garment.template, scene.garment.faces, scene.pins.vertices
    limbs, strain = limbs_of(scene.body, scene.collider), make_strain_tables(scene.garment, pins)
    tables = make_limb_crossing_tables(scene.garment, limbs, uniform_table(faces, len(T)), strain)
    assert tables is not None
    carried = carried_points(scene, collider=False, limbs=limbs)
    bones = pose_carried(carried, scene, motion, slice(0, len(V))).bones
    free = jnp.ones(len(T), bool).at[pins].set(False)
    step = jax.jit(lambda state, v, b: undo_crossings(state, v, b, free=free, tables=tables))
    state = init_crossings(jnp.asarray(V[0]), jnp.asarray(bones[0]))
    jax.block_until_ready(step(state, jnp.asarray(V[0]), jnp.asarray(bones[0])))
    wall, pierced, kept = np.zeros(len(V)), np.zeros(len(V), int), np.zeros_like(V)
    for t in range(len(V)):
        v, b = jax.block_until_ready((jnp.asarray(V[t]), jnp.asarray(bones[t])))
        began = time.perf_counter()
        state, out, count = jax.block_until_ready(step(state, v, b))
        wall[t], pierced[t], kept[t] = 1e3 * (time.perf_counter() - began), int(count), np.asarray(out)
    near = np.array([_least_distance(v, b) < tables.reach for v, b in zip(V, bones, strict=True)])
    through = pierced > 0
    return {
        "clip": name,
        "rmse_cm": rmse(V, V_star),
        "after_cm": rmse(kept, V_star),
        "pierced_%": 100 * float(through.mean()),
        "pierced_after_%": 100 * float((pierced_bones(kept, bones, faces) > 0).mean()),
        "truth_%": 100 * float((pierced_bones(V_star, bones, faces) > 0).mean()),
        "ms_apart": _median(wall[~near]),
        "ms_near": _median(wall[near & ~through]),
        "ms_pierced": _median(wall[through]),
    }


def _least_distance(v: np.ndarray, bones: np.ndarray) -> float:
    axis = bones[:, 1] - bones[:, 0]
    apart = v[None] - bones[:, None, 0]
    along = np.clip((apart * axis[:, None]).sum(-1) / (axis**2).sum(-1)[:, None], 0, 1)
    return float(np.linalg.norm(apart - along[..., None] * axis[:, None], axis=-1).min())


def _median(values: np.ndarray) -> float:
    return float(np.median(values)) if len(values) else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rollouts", type=Path, help="folder of rollouts")
    parser.add_argument("truth", type=Path, help="folder of the same clips, simulated")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    clips = sorted(options.rollouts.glob("*.h5"))
    rows = [measure(path, options.truth / path.name) for path in clips]
    report(rows, title="cloth put back on its side of the limbs", facts={}, json_path=options.json)


if __name__ == "__main__":
    main()
