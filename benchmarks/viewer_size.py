"""Megabytes and seconds of the page that `garment-jax view` writes, at four times the garment's triangles.

    python benchmarks/viewer_size.py PRED.h5 [TRUTH.h5]

Every edge is halved in garment and UVs, so that a clip of a few thousand vertices shows what a fine
one costs.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import SequenceWriter, open_sequence
from garment_jax.viewer.command import view_files


def halved(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return `points` `[..., n, c]` followed by the middles of `edges`."""
    middles = (points[..., edges[:, 0], :] + points[..., edges[:, 1], :]) / 2
    return np.concatenate([points, middles], axis=-2).astype(np.float32)


def quartered(faces: np.ndarray, edges: np.ndarray, points: int) -> np.ndarray:
    """Return four triangles for each, over the points of `halved`."""
    middle = {tuple(sorted(edge)): points + i for i, edge in enumerate(edges.tolist())}
    parts = []
    for a, b, c in faces.tolist():
        ab, bc, ca = (middle[min(pair), max(pair)] for pair in ((a, b), (b, c), (c, a)))
        parts += [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return np.array(parts, np.int32)


def write_fine(path: Path, out: Path) -> tuple[int, int]:
    """Write the clip with its edges halved; return vertices and frames."""
    with open_sequence(path) as clip:
        garment = clip.scene.garment
        edges, seams = unique_edges(garment.faces), unique_edges(garment.faces_uv)
        fine = garment._replace(
            template=halved(garment.template, edges),
            faces=quartered(garment.faces, edges, len(garment.template)),
            uv=halved(garment.uv, seams),
            faces_uv=quartered(garment.faces_uv, seams, len(garment.uv)),
        )
        kept = {k: v for k, v in clip.attributes.items() if k in ("name", "kind")}
        scene = clip.scene._replace(garment=fine)
        with SequenceWriter(out, scene, clip.motion, attributes=kept) as writer:
            for _, V in clip.windows(64):
                writer.append(halved(V, edges))
        return len(fine.template), clip.frames


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("clips", nargs="+", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        fine = [Path(folder) / f"{k}.h5" for k in range(len(options.clips))]
        sizes = [write_fine(path, out) for path, out in zip(options.clips, fine, strict=True)]
        page, began = Path(folder) / "page.html", time.perf_counter()
        view_files(fine, page)
        seconds = time.perf_counter() - began
        print(f"{len(fine)} files, {sizes[0][0]} vertices, {sizes[0][1]} frames:", end=" ")
        print(f"{page.stat().st_size / 1e6:.1f} MB in {seconds:.1f} s")


if __name__ == "__main__":
    main()
