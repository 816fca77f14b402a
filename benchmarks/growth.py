"""How time and memory grow with vertices, UV size, body, batch and frames: fitted exponents and a plot.

    python benchmarks/growth.py vertices|uv|body|batch|frames [--clip CLIP.h5] [--json FILE]
    python benchmarks/growth.py plot --from FILE... --out PICTURE

Time is of a frame of one stream (of a whole rollout for "frames", of all copies for "batch"); memory is what
the compiled chunk of 32 frames holds: arguments, results and what lies between. An exponent of 1 is linear;
"last" is the one between the two largest sizes, where constant costs count least.
"""

import argparse
import json
from pathlib import Path

import jax
import numpy as np
import trimesh
from pipeline_speed import CHUNK, collision_samples, network_samples
from sized import Case, dressed, make_case, predictions, repeated, sized_config

from garment_jax.bench.figures import report
from garment_jax.body.looped_motion import looped_motion
from garment_jax.model.scan import make_rollout
from garment_jax.structs import RiggedBody, Scene

SIZES = {
    "vertices": (1_000, 2_800, 9_352, 30_000, 100_000),
    "uv": (32, 64, 128, 256),
    "body": (0, 1, 2),  # whole body, each triangle cut into four so many times
    "batch": (1, 2, 4, 8, 16, 32),
    "frames": (64, 128, 512, 2048),  # the clip is looped to this length
}
UNITS = {
    "vertices": "vertices of the garment",
    "uv": "texels a side",
    "body": "vertices of the body",
    "batch": "motions side by side",
    "frames": "frames",
}
FRAMES = 4 * CHUNK


def exponents(sizes: list[float], values: list[float]) -> tuple[float, float]:
    """Return the exponent of a power law fitted to all points, and the one between the last two."""
    x, y = np.log(sizes), np.log(values)
    return float(np.polyfit(x, y, 1)[0]), float((y[-1] - y[-2]) / (x[-1] - x[-2]))


def chunk_megabytes(case: Case, copies: int = 1) -> float:
    """Return the memory of the compiled chunk: arguments, results, and what lies between."""
    x, start = jax.tree.map(lambda leaf: leaf[:CHUNK], case.x), case.start
    if copies > 1:
        x = jax.tree.map(lambda leaf: np.repeat(leaf[:, None], copies, axis=1), x)
        start = repeated(start, copies)
    run = make_rollout(case.template, case.config)
    memory = run.lower(case.params, start, x).compile().memory_analysis()  # type: ignore[attr-defined]
    held = memory.argument_size_in_bytes + memory.output_size_in_bytes + memory.temp_size_in_bytes
    return held / 1e6


def finer_body(body: RiggedBody, times: int) -> RiggedBody:
    """Return `body` with every triangle cut into four, `times` times."""
    vertices, faces, weights = body.vertices, body.faces, body.skin_weights
    for _ in range(times):
        vertices, faces, attributes = trimesh.remesh.subdivide(
            vertices, faces, vertex_attributes={"w": weights}
        )[:3]
        weights = attributes["w"]
    return body._replace(
        vertices=np.asarray(vertices, np.float32),
        faces=np.asarray(faces, np.int32),
        skin_weights=np.asarray(weights, np.float32),
    )


def point(kind: str, size: int, scene: Scene, motion, predicted: np.ndarray | None) -> dict:
    """Return one row: the size, milliseconds, megabytes."""
    vertices = size if kind == "vertices" else 9_352
    if kind == "frames":
        motion = looped_motion(motion, size)
    config = sized_config(size if kind == "uv" else 128)
    case = make_case(scene, motion, vertices=vertices, config=config, predicted=predicted)
    n = len(case.template.T)
    if kind == "body":
        body = finer_body(scene.body, size)
        case = case._replace(scene=case.scene._replace(body=body, collider=None))
        ms = np.median(collision_samples(case, whole_body=True)[0])
        return {"size": len(body.vertices), "collision ms": float(ms)}
    if kind == "frames":
        return {"size": size, "networks ms": float(network_samples(case).sum() * CHUNK)}
    copies = size if kind == "batch" else 1
    row = {"size": n if kind == "vertices" else size}
    row["networks ms"] = float(np.median(network_samples(case, copies=copies)))
    row["networks MB"] = chunk_megabytes(case, copies)
    if kind == "vertices":
        row["collision ms"] = float(np.median(collision_samples(case, whole_body=False)[0]))
    return row


def plot(files: list[Path], out: Path) -> None:
    """Draw every file's rows, both axes logarithmic, one panel a file."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.ticker import NullLocator

    figure, panels = plt.subplots(1, len(files), figsize=(3.1 * len(files), 3), squeeze=False)
    for panel, file in zip(panels[0], files, strict=True):
        found = json.loads(file.read_text(encoding="utf-8"))
        rows, kind = found["rows"], found["facts"]["of"]
        for name in (key for key in rows[0] if key != "size"):
            label = f"{name} ({found['facts'][f'{name} exponent']:.2f})"
            panel.loglog([row["size"] for row in rows], [row[name] for row in rows], "o-", label=label)
        panel.set_xlabel(UNITS[kind])
        panel.set_xticks([row["size"] for row in rows], [f"{row['size']:,}" for row in rows], fontsize=6)
        panel.xaxis.set_minor_locator(NullLocator())
        panel.legend(fontsize=7)
        panel.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("of", choices=[*SIZES, "plot"])
    parser.add_argument("--clip", type=Path)
    parser.add_argument("--model", type=Path, default=Path("models/skirt"))
    parser.add_argument("--from", dest="files", type=Path, nargs="+", default=[])
    parser.add_argument("--out", type=Path, default=Path("growth.png"))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.of == "plot":
        plot(options.files, options.out)
        return
    frames = None if options.of == "frames" else FRAMES
    scene, motion = dressed(options.clip, frames)
    collides = options.of in ("vertices", "body")
    predicted = predictions(options.model, options.clip, FRAMES) if options.clip and collides else None
    rows = []
    for size in SIZES[options.of]:
        rows.append(point(options.of, size, scene, motion, predicted))
        jax.clear_caches()
    facts: dict = {"of": options.of, "clip": options.clip.stem if options.clip else "embedded walk"}
    for name in (key for key in rows[0] if key != "size"):
        facts[f"{name} exponent"], facts[f"{name} last"] = exponents(
            [row["size"] for row in rows], [row[name] for row in rows]
        )
    report(rows, title=f"Growth with {options.of}", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
