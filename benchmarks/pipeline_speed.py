"""Milliseconds of the whole pipeline at a wanted size, and which part of the machine's limit it reaches.

    python benchmarks/pipeline_speed.py [--vertices 9352] [--uv 128] [--rank 0] [--clip CLIP.h5]
        [--whole-body] [--batch 16] [--frames 256] [--only networks collision batch stages] [--json FILE]

Networks with random parameters (`sized.py`): previous state, D_rec of three hidden layers of 512 and a whole
last layer (`--rank 96`: a factored one), D_dyn, detail, float32, one stream, compiled chunks of 32 frames.
Collision handling runs on what `--model` predicts for the same motion, resampled; without a clip on the
embedded mannequin with the template carried by it. Samples are chunks; the median counts.

Limits: a stage can take no less than its FLOPs at the machine's rate of a 1024 x 1024 matrix product, and
no less than its bytes at the rate at which so many bytes are read, from the cache if they fit; the whole step
reads all parameters every frame, at that size's rate. Both rates are the best of the same run. "limit" is the
larger one (of the whole step: their sum), "reached" limit / time. On a machine with a GPU the same
command measures it; without one its rows are open.
"""

import argparse
import time
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from counts import frame_work, parameter_bytes, total
from machine_rates import matmul_rate, read_rate
from sized import Case, dressed, make_case, predictions, repeated, sized_config
from stage_times import milliseconds, stages

from garment_jax.animation.chunks import scan_frames, solver_options
from garment_jax.animation.clips import rollout_chunks
from garment_jax.animation.stream import first_of
from garment_jax.bench.figures import report
from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.model.scan import make_rollout
from garment_jax.postprocess.collision import CollisionOptions
from garment_jax.postprocess.collision.solid import everything
from garment_jax.postprocess.pipeline import BodyFrame, contact_init, contact_step
from garment_jax.postprocess.tables import make_contact_tables

CHUNK = 32


def samples_of(pieces, frames: int = CHUNK) -> np.ndarray:
    """Return milliseconds a frame of every piece after the first, which compiles."""
    seconds = []
    began = time.perf_counter()
    for piece in pieces:
        jax.block_until_ready(piece)
        seconds.append(time.perf_counter() - began)
        began = time.perf_counter()
    return 1e3 * np.array(seconds[1:]) / frames


def network_samples(case: Case, *, detail: bool = True, copies: int = 1) -> np.ndarray:
    """Return the networks' milliseconds a frame, of `copies` motions side by side."""
    run = make_rollout(case.template, case.config, detail=detail)
    x, start = case.x, case.start
    if copies > 1:
        x = jax.tree.map(lambda leaf: np.repeat(leaf[:, None], copies, axis=1), x)
        start = repeated(start, copies)
    again = jax.tree.map(lambda leaf: np.concatenate([leaf[:CHUNK], leaf]), x)  # the first chunk compiles
    return samples_of(V for _, V in rollout_chunks(run, case.params, start, again, chunk=CHUNK))


def collision_samples(case: Case, *, whole_body: bool) -> tuple[np.ndarray, float]:
    """Return the solver's milliseconds a frame and the part of frames that had something to resolve."""
    scene = case.scene
    if whole_body or scene.collider is None:
        scene = scene._replace(collider=everything(scene.body))
    assert scene.collider is not None
    settings = case.config.collision
    options = CollisionOptions(eps=settings.eps, iterations=settings.iterations, tolerance=settings.tolerance)
    carried = carried_points(scene, collider=True)
    tables = make_contact_tables(
        scene.garment, case.template.laplacian, scene.collider, scene.body, carried.pins, options=options
    )._replace(strain=None)
    resolve = scan_frames(partial(contact_step, tables=tables), solver_options(case.V.shape[1]))
    found: list[np.ndarray] = []

    def pieces():
        state = None
        for start in [0, *range(0, len(case.V), CHUNK)]:
            stretch = slice(start, start + CHUNK)
            body = BodyFrame(*map(jnp.asarray, pose_carried(carried, scene, case.motion, stretch)))
            V = jnp.asarray(case.V[stretch])
            state = contact_init(V[0], first_of(body), tables=tables) if state is None else state
            jax.block_until_ready((V, body))
            yield None  # what was prepared on the host does not count
            state, V, figures = resolve(state, V, body)
            found.append(np.asarray(figures.steps) > 0)
            yield V

    seconds, began, real = [], time.perf_counter(), False
    for piece in pieces():
        jax.block_until_ready(piece)
        if real:
            seconds.append(time.perf_counter() - began)
        began, real = time.perf_counter(), not real
    return 1e3 * np.array(seconds[1:]) / CHUNK, float(np.concatenate(found[1:]).mean())


def speed_rows(case: Case, options: argparse.Namespace) -> list[dict]:
    """Return the rows of whole frames: networks, collision, both, a batch."""
    rows: list[dict] = []
    networks = collision = None
    if "networks" in options.only:
        plain = network_samples(case, detail=False)
        rows.append(_row("networks", plain))
        networks = network_samples(case)
        rows.append(_row("networks, detail", networks))
    if "collision" in options.only:
        collision, part = collision_samples(case, whole_body=options.whole_body)
        rows.append(_row(f"collision ({part:.0%} of frames in contact)", collision))
    if networks is not None and collision is not None:
        count = min(len(networks), len(collision))
        rows.append(_row("networks, detail, collision", networks[:count] + collision[:count]))
    if "batch" in options.only:
        rows.append(
            _row(f"batch of {options.batch}", network_samples(case, copies=options.batch) / options.batch)
        )
    return rows


def _row(name: str, samples: np.ndarray) -> dict:
    median, late = np.percentile(samples, [50, 95])
    return {
        "part": name,
        "median ms": float(median),
        "p95 ms": float(late),
        "frames/s": float(1e3 / samples.mean()),
    }


def limit_rows(case: Case, whole_ms: float | None) -> tuple[list[dict], dict]:
    """Return each stage's time beside its limit, and the rates of the machine in this run."""
    flops, memory = matmul_rate(), read_rate(parameter_bytes(case.params))
    work, rows = frame_work(case.params, case.template, case.config), []
    for name, (f, x, params) in stages(case).items():
        own = read_rate(work[name].bytes)
        rows.append(_limit_row(name, work[name], milliseconds(f, x, params), flops, own))
    rows.sort(key=lambda row: -row["ms"])
    if whole_ms is not None:
        limit = 1e3 * sum(max(w.flops / flops, w.bytes / memory) for w in work.values())
        row = _limit_row("networks, detail (whole step)", total(work), whole_ms, flops, memory)
        rows.append(row | {"limit ms": limit, "reached %": 100 * limit / whole_ms, "bound": "sum"})
    facts = {
        "matrix product GFLOP/s": flops / 1e9,
        "reading GB/s": memory / 1e9,
        "read MB": parameter_bytes(case.params) / 1e6,
    }
    return rows, facts


def _limit_row(name: str, work, ms: float, flops: float, memory: float) -> dict:
    compute, read = 1e3 * work.flops / flops, 1e3 * work.bytes / memory
    return {
        "stage": name,
        "ms": ms,
        "MFLOP": work.flops / 1e6,
        "MB": work.bytes / 1e6,
        "bound": "FLOPs" if compute > read else "bytes",
        "limit ms": max(compute, read),
        "reached %": 100 * max(compute, read) / ms,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vertices", type=int, default=9352)
    parser.add_argument("--uv", type=int, default=128)
    parser.add_argument("--rank", type=int, default=0, help="of D_rec's last layer; 0: whole")
    parser.add_argument("--clip", type=Path, help="sequence file of the model's garment")
    parser.add_argument("--model", type=Path, default=Path("models/skirt"))
    parser.add_argument("--whole-body", action="store_true")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--frames", type=int, default=256)
    parser.add_argument("--only", nargs="+", default=["networks", "collision", "batch", "stages"])
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    options.frames -= options.frames % CHUNK
    scene, motion = dressed(options.clip, options.frames)
    predicted = None if options.clip is None else predictions(options.model, options.clip, options.frames)
    config = sized_config(options.uv, rank=options.rank)
    case = make_case(scene, motion, vertices=options.vertices, config=config, predicted=predicted)
    facts = {
        "vertices": len(case.template.T),
        "UV": options.uv,
        "rank": options.rank or "whole",
        "body": len(scene.body.vertices),
        "collider": "whole body" if options.whole_body or scene.collider is None else "reachable part",
        "frames": len(case.V),
        "precision": "float32",
        "GPU": "measured" if jax.default_backend() == "gpu" else "open: none on this machine",
    }
    rows = speed_rows(case, options)
    whole = next((row["median ms"] for row in rows if row["part"] == "networks, detail"), None)
    if "stages" in options.only:
        limits, rates = limit_rows(case, whole)
        json_path = options.json and options.json.with_suffix(".stages.json")
        report(limits, title="Stages against the machine's limit", facts=facts | rates, json_path=json_path)
    if rows:
        report(rows, title="Pipeline speed", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
