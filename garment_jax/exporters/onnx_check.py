"""The exported graphs run by onnxruntime beside JAX: how far they depart, and how long each takes."""

import time
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.exporters.step_subject import StepSubject, first_state, frame_fields, step_function
from garment_jax.model.compose import RolloutState
from garment_jax.model.scan import make_rollout
from garment_jax.postprocess.pins import attach, pin_extension

TOLERANCE = 1e-4  # metres, and the motion features' own units
COLUMN_RNN_TOLERANCE = 2e-3  # metres: a point of the body on the border of two sectors may count to either
OUTPUTS = ("V", "h_next", "V_prev_next")


class Comparison(NamedTuple):
    """A rollout by JAX and one by onnxruntime, each feeding its own state back."""

    departure: np.ndarray  # [t] metres, the largest over vertices and axes
    seconds_jax: np.ndarray  # [t] the first compiles
    seconds_onnx: np.ndarray  # [t]


def compare_rollouts(
    subject: StepSubject, detail: bool, step_graph: bytes, *, threads: int = 0
) -> Comparison:
    """Roll the subject's motion out both ways, frame by frame on the CPU; 0 `threads` are all cores."""
    session = open_graph(step_graph, threads=threads)
    inputs, ((h, V_prev), _) = first_state(subject)
    compiled, fields = jax.jit(step_function(subject, detail)), frame_fields(subject)
    state_jax, state_onnx, rows = [h, V_prev], [np.asarray(h), np.asarray(V_prev)], []
    for t in range(len(inputs.x.M)):
        x = [getattr(inputs.x, name)[t] for name in fields]
        began = time.perf_counter()
        V, *state_jax = jax.block_until_ready(compiled(*state_jax, *x))
        between = time.perf_counter()
        given = dict(zip(("h", "V_prev", *fields), (*state_onnx, *x), strict=True))
        made, *state_onnx = session.run(OUTPUTS, given)
        ended = time.perf_counter()
        rows.append((np.abs(np.asarray(V) - made).max(), between - began, ended - between))
    return Comparison(*np.array(rows).T)


def open_graph(graph: bytes, *, threads: int = 0) -> Any:
    """Return an onnxruntime session of a serialised graph on the CPU."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    return onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


def check_graphs(
    subject: StepSubject,
    detail: bool,
    step_graph: bytes,
    start_graph: bytes,
    frame_graph: bytes,
    *,
    attach_graph: bytes | None = None,
    column_rnn_graph: bytes | None = None,
) -> dict[str, float]:
    """Return the graphs' largest departures from JAX and the host over the subject's motion.

    Raises `ValueError` where one reaches 1e-4 (metres for garments) or is not a number.
    """
    found = {
        "step": compare_rollouts(subject, detail, step_graph).departure.max(),
        "start": _start_departure(subject, start_graph),
        "frame": _frame_departure(subject, frame_graph),
    }
    if attach_graph is not None:
        found["attach"] = _attach_departure(subject, attach_graph)
    if column_rnn_graph is not None:
        found["column_rnn"] = _column_rnn_departure(subject, detail, start_graph, column_rnn_graph)
    for name, value in found.items():
        allowed = COLUMN_RNN_TOLERANCE if name == "column_rnn" else TOLERANCE
        if not value < allowed:
            raise ValueError(
                f"the {name} graph departs from JAX by {value:.3g}, {allowed:g} is allowed; nothing was "
                "written. Try another version of onnxruntime, and report it."
            )
    return {f"{name}_departure": float(value) for name, value in found.items()}


def _start_departure(subject: StepSubject, graph: bytes) -> float:
    rotations = subject.motion.rotations[0].astype(np.float32)
    h, V_prev = open_graph(graph).run(["h", "V_prev"], {"rotations": rotations})
    state = first_state(subject)[1].motion
    return float(max(np.abs(V_prev - state.V_prev).max(), np.abs(h - state.h).max()))


def _frame_departure(subject: StepSubject, graph: bytes) -> float:
    """Frame 0 is left out: its predecessor is the host's choice."""
    session, x = open_graph(graph), first_state(subject)[0].x
    R, root = (np.asarray(leaf, np.float32) for leaf in subject.motion[:2])
    worst, names = 0.0, frame_fields(subject)
    expected = [getattr(x, name) for name in names]
    for t in range(1, len(R)):
        skeletons = {"rotations": R[t], "root": root[t], "rotations_prev": R[t - 1], "root_prev": root[t - 1]}
        made = session.run(list(names), skeletons)
        worst = max(worst, *(float(np.abs(a - b[t]).max()) for a, b in zip(made, expected, strict=True)))
    return worst


def _column_rnn_departure(subject: StepSubject, detail: bool, start_graph: bytes, graph: bytes) -> float:
    """The latents' frames corrected by the graph, from the skeleton alone, and by the package."""
    model, template = subject.model, subject.template
    inputs, state = first_state(subject)
    run = make_rollout(template, model.config, detail=detail)
    latents, expected = (
        np.asarray(run(model.params, s, inputs.x)[1]) for s in (RolloutState(state.motion), state)
    )
    R, root = (np.asarray(leaf, np.float32) for leaf in subject.motion[:2])
    column_rnn = open_graph(start_graph).run(["column_rnn"], {"rotations": R[0]})[0]
    session, worst = open_graph(graph), 0.0
    for t in range(len(R)):
        before = max(t - 1, 0)
        given = {"rotations": R[t], "root": root[t], "rotations_prev": R[before], "root_prev": root[before]}
        V, column_rnn = session.run(
            ["V_corrected", "column_rnn_next"], {"V": latents[t], "column_rnn": column_rnn, **given}
        )
        worst = max(worst, float(np.abs(V - expected[t]).max()))
    return worst


def _attach_departure(subject: StepSubject, graph: bytes) -> float:
    """The template with its pins moved by some centimetres, each by its own."""
    scene = subject.scene
    assert scene.pins is not None
    pins, V = scene.pins.vertices, subject.template.T
    moved = V[pins] + 0.05 * np.sin(np.arange(3 * len(pins), dtype=np.float32)).reshape(-1, 3)
    made = open_graph(graph).run(["V_attached"], {"V": V, "pins": moved})[0]
    extension = pin_extension(scene.garment, pins)
    expected = attach(jnp.asarray(V), jnp.asarray(moved), pins=pins, extension=extension)
    return float(np.abs(made - np.asarray(expected)).max())
