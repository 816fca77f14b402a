"""Milliseconds per frame of collision handling on a shared clip, with and without contact.

    python benchmarks/collision.py DATA [--clip test_salsa_27] [--frames 60]

DATA is the folder that holds skirt/ and avatar/. "Without contact" is the simulated garment as it is;
"with contact" the same after pushing what lies within 6 cm of the body 1 cm towards it. Frames follow
each other, each starting from the last one's state, as in a rollout. Medians (tenth and ninetieth
percentile) without compilation; processor time besides, which other programs on the machine disturb
less.
"""

import argparse
import os
import platform
import time
from functools import partial
from pathlib import Path

import h5py
import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.kinematics import collider_points, pose_body
from garment_jax.collision import (
    CollisionTables,
    Outcome,
    initial_state,
    make_collider_tables,
    make_collision_tables,
    resolve_collisions,
)
from garment_jax.data.packed_clip import decode_steps, find_assets, read_scene
from garment_jax.geometry.closest_point import closest_point_exact, closest_point_from
from garment_jax.geometry.laplacian import uniform_table
from garment_jax.structs import Motion


def read_clip(path: Path, frames: int):
    """Return scene, garment `[t, n, 3]` and collider `[t, c, 3]`, metres relative to the root joint."""
    with h5py.File(path) as file:
        scene = read_scene(file, find_assets(file, path, {}, None), path.name)
        motion = Motion(file["rotations"][:frames], file["root"][:frames], 30.0)
        steps = np.concatenate(list(decode_steps(file["vertices_delta"][:frames])))
        V = steps * file["vertices_delta"].attrs["scale"]
    body = pose_body(scene.body, motion, np.arange(frames)) - motion.root[:, None]
    return scene, V.astype(np.float32), collider_points(scene.collider, body).astype(np.float32)


def push(V: np.ndarray, C: np.ndarray, tables: CollisionTables, depth: float) -> np.ndarray:
    """Return the garment with what is near the body moved `depth` metres towards it."""
    exact = jax.jit(partial(closest_point_exact, tables=tables.surface))
    moved = []
    for v, c in zip(V, C, strict=True):
        at = exact(jnp.asarray(v), jnp.asarray(c))
        moved.append(jnp.where((at.ds < 0.06)[:, None], v - depth * at.direction, v))
    return np.stack(moved)


def measure(name: str, step, V, C, state) -> None:
    """Print the median and the tenth and ninetieth percentile over consecutive frames."""
    jax.block_until_ready(step(V[0], C[0], state))
    wall, outcomes, cpu = [], [], time.process_time()
    for v, c in zip(V, C, strict=True):
        start = time.perf_counter()
        result, state = jax.block_until_ready(step(v, c, state))
        wall.append(1e3 * (time.perf_counter() - start))
        outcomes.append(int(getattr(result, "outcome", -1)))
    cpu = 1e3 * (time.process_time() - cpu) / len(V)
    low, median, high = np.percentile(wall, [10, 50, 90])
    kinds = dict(zip(*np.unique(outcomes, return_counts=True), strict=True))
    names = {Outcome(k).name if k >= 0 else "": int(v) for k, v in kinds.items()}
    print(
        f"{name:20s} {median:7.2f} ms ({low:.2f} ... {high:.2f}), {cpu:.2f} ms of both cores' time, {names}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    parser.add_argument("--clip", default="test_salsa_27")
    parser.add_argument("--frames", type=int, default=60)
    options = parser.parse_args()
    scene, V, C = read_clip(options.data / "skirt" / f"{options.clip}.h5", options.frames)
    T, pins = np.asarray(scene.garment.template), scene.pins.vertices
    surface = make_collider_tables(scene.collider, scene.body)
    tables = make_collision_tables(T, uniform_table(scene.garment.faces, len(T)), surface)
    machine = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
    print(f"{machine}, load {os.getloadavg()[0]:.1f}, jax {jax.__version__}")
    print(f"{options.clip}: {V.shape[1]} garment vertices, {C.shape[1]} collider vertices, {len(V)} frames")

    def frame(v, c, state):
        return resolve_collisions(v, c, state, tables=tables, pins=pins, pin_positions=v[pins])

    def search(v, c, state):
        at = closest_point_from(state.triangle, v, c, surface, tables.groups)
        return at, state._replace(triangle=at.triangle)

    state = initial_state(V[0], C[0], surface)
    measure("search alone", jax.jit(search), V, C, state)
    measure("without contact", jax.jit(frame), V, C, state)
    pushed = push(V, C, tables, 0.01)
    measure("with contact", jax.jit(frame), pushed, C, initial_state(pushed[0], C[0], surface))


if __name__ == "__main__":
    main()
