"""The exported step in onnxruntime beside JAX's, frame by frame on this CPU: time, departure, size.

    python benchmarks/onnx_step.py models/skirt CLIP.h5 [--frames 100] [--graph OTHER.onnx]

Both feed their own state back from the same first frame. Medians leave out the first frames, in which JAX
compiles. Needs the extra `onnx`.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from garment_jax.export.onnx_check import compare_rollouts
from garment_jax.export.onnx_step import export_step
from garment_jax.export.step_subject import load_subject

WARM = 5  # frames


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("model", type=Path)
    parser.add_argument("clip", type=Path)
    parser.add_argument("--frames", type=int, default=100)
    parser.add_argument("--graph", type=Path, help="a step that was exported before")
    options = parser.parse_args()
    subject = load_subject(options.model, options.clip, frames=options.frames)
    with tempfile.TemporaryDirectory() as folder:
        graph = options.graph or Path(folder) / "step.onnx"
        if options.graph is None:
            export_step(options.model, graph, clip=options.clip, check=False)
        found = compare_rollouts(subject, True, graph.read_bytes())
        size = graph.stat().st_size / 1e6
    milliseconds = [1e3 * np.median(x[WARM:]) for x in (found.seconds_jax, found.seconds_onnx)]
    print(f"{size:.1f} MB, {len(found.departure)} frames, departure {found.departure.max():.2e} m")
    print(f"median ms a frame: JAX {milliseconds[0]:.2f}, onnxruntime {milliseconds[1]:.2f}")


if __name__ == "__main__":
    main()
