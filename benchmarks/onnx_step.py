"""The exported step in onnxruntime beside JAX's, frame by frame on this CPU: time, departure, size.

    python benchmarks/onnx_step.py models/skirt CLIP.h5 [--frames 100] [--graph OTHER.onnx]

Both feed their own state back from the same first frame. Medians leave out the first frames, in which JAX
compiles. Where the model has a column RNN, its graph's time is given, too. Needs the extra `onnx`.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from garment_jax.exporters.onnx_check import compare_rollouts, open_graph
from garment_jax.exporters.onnx_step import export_step
from garment_jax.exporters.step_subject import StepSubject, load_subject

WARM = 5  # frames


def column_rnn_seconds(subject: StepSubject, graph: bytes) -> np.ndarray:
    """Return the seconds that onnxruntime takes for each frame of the column RNN's graph, on the template."""
    session, R = open_graph(graph), subject.motion.rotations.astype(np.float32)
    root = subject.motion.root.astype(np.float32)
    size = next(port.shape[0] for port in session.get_inputs() if port.name == "column_rnn")
    column_rnn, seconds = np.zeros(size, np.float32), []
    for t in range(1, len(R)):
        given = {"V": subject.template.T, "column_rnn": column_rnn, "rotations": R[t], "root": root[t]}
        given |= {"rotations_prev": R[t - 1], "root_prev": root[t - 1]}
        began = time.perf_counter()
        column_rnn = session.run(["V_corrected", "column_rnn_next"], given)[1]
        seconds.append(time.perf_counter() - began)
    return np.array(seconds)


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
        column_rnn = graph.with_suffix(".column_rnn.onnx")
        has_column_rnn = column_rnn_seconds(subject, column_rnn.read_bytes()) if column_rnn.exists() else None
    milliseconds = [1e3 * np.median(x[WARM:]) for x in (found.seconds_jax, found.seconds_onnx)]
    print(f"{size:.1f} MB, {len(found.departure)} frames, departure {found.departure.max():.2e} m")
    print(f"median ms a frame: JAX {milliseconds[0]:.2f}, onnxruntime {milliseconds[1]:.2f}")
    if has_column_rnn is not None:
        print(f"median ms a frame of the column RNN: onnxruntime {1e3 * np.median(column_rnn[WARM:]):.2f}")


if __name__ == "__main__":
    main()
