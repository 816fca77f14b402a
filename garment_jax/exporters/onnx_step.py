"""A trained model becomes a few ONNX graphs, which engines run frame by frame (see docs/onnx.md).

`NAME.onnx` is the causal step, `NAME.start.onnx` the first state from a skeleton's pose, `NAME.frame.onnx`
the step's inputs from the skeleton of this frame and of the last, `NAME.column_rnn.onnx` corrects the step's
garment where the model has a column RNN, `NAME.attach.onnx` brings a pinned garment to its pins.
"""

import json
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.body.motion_features import chosen_joints, feature_names
from garment_jax.exporters.column_rnn_functions import begun, flat, length
from garment_jax.exporters.host_functions import first_frame, frame_input
from garment_jax.exporters.onnx_check import check_graphs
from garment_jax.exporters.onnx_graph import Port, check_opset, to_onnx
from garment_jax.exporters.step_subject import (
    StepSubject,
    column_rnn_function,
    frame_fields,
    load_subject,
    step_function,
)
from garment_jax.geometry.skinning import softmax_weights
from garment_jax.model.scene_file import SCENE
from garment_jax.postprocess.pins import follow, pin_extension
from garment_jax.storage.overwriting import check_free
from garment_jax.storage.whole import written_whole

SCHEMA = "garment_jax-step-1"
OPSET = 17  # the newest that onnxruntime 1.12 (2022) and the hosts built on it load
_MAYBE = ("attach", "column_rnn")  # graphs that not every model has
_BESIDE = ("start", "frame", *_MAYBE)
CHECKED_FRAMES = 20  # of the clip, run by onnxruntime and by JAX


def export_step(
    run_or_model: str | Path,
    out: str | Path,
    *,
    clip: str | Path | None = None,
    detail: bool = True,
    opset: int | None = None,
    check: bool = True,
    force: bool = False,
    say: Callable[[str], object] = lambda text: None,
) -> dict[str, Any]:
    """Write the step of a run or model as ONNX graphs: `out` and, beside it, what goes with it.

    `clip` is any sequence file of the garment, by default the model's own sample: template, faces, UVs and
    body are the clip's. `check` runs the graphs over its first frames and compares them with
    JAX; `force` replaces graphs that are there; `say` gets a line before the long part. Returns the facts:
    files with megabytes and nodes, and what the check measured. Raises `ValueError`, `OSError` or
    `FileNotFoundError` for a model or clip that does not fit, an operator set that is not written here, a
    graph that departs from JAX by more than 0.1 mm, or a missing package.
    """
    out, opset = Path(out), OPSET if opset is None else opset
    if out.suffix != ".onnx":
        raise ValueError(f"{out} does not end in .onnx; name the step's file so.")
    if clip is None:
        clip = Path(run_or_model) / SCENE
        if not clip.is_file():
            raise ValueError(
                f"{run_or_model} has no sample; name any sequence file of its garment with --clip."
            )
    check_opset(opset)
    _need("onnx", *(["onnxruntime"] if check else []))
    for path in [out, *(out.with_suffix(f".{kind}.onnx") for kind in _BESIDE)]:
        check_free(path, force)
    subject = load_subject(run_or_model, clip, frames=CHECKED_FRAMES)
    count = 3 + (subject.template.ring is not None) + (subject.scene.pins is not None)
    say(f"building {'and checking ' * check}{count} graphs")
    graphs = {
        out: _step_graph(subject, detail, opset),
        out.with_suffix(".start.onnx"): _start_graph(subject, opset),
        out.with_suffix(".frame.onnx"): _frame_graph(subject, opset),
    }
    if subject.template.ring is not None:
        graphs[out.with_suffix(".column_rnn.onnx")] = _column_rnn_graph(subject, opset)
    if subject.scene.pins is not None:
        graphs[out.with_suffix(".attach.onnx")] = _attach_graph(subject, subject.scene.pins.vertices, opset)
    serial = {path: graph.SerializeToString() for path, graph in graphs.items()}
    kinds = {f"{kind}_graph": serial.get(out.with_suffix(f".{kind}.onnx")) for kind in _MAYBE}
    measured = check_graphs(subject, detail, *list(serial.values())[:3], **kinds) if check else {}
    beside = [out.with_suffix(f".{kind}.onnx") for kind in _MAYBE]
    stale = [path for path in beside if path not in serial]  # of another model that lay here
    with written_whole(*serial, last=[out], gone=stale) as temporary:
        for path, content in zip(temporary, serial.values(), strict=True):
            path.write_bytes(content)
    files = {
        str(path): {"megabytes": round(len(serial[path]) / 1e6, 3), "nodes": len(graph.graph.node)}
        for path, graph in graphs.items()
    }
    return {"files": files, "opset": opset, "detail": detail and "detail" in subject.model.params, **measured}


def _need(*packages: str) -> None:
    for package in packages:
        try:
            import_module(package)
        except ImportError as error:
            raise ValueError(f"ONNX needs the package {package}; pip install 'garment-jax[onnx]'.") from error


def _step_graph(subject: StepSubject, detail: bool, opset: int) -> Any:
    config, n = subject.model.config, len(subject.template.T)
    d = len(subject.template.statistics.motion_mean)
    frame = "metres, root frame of "
    j, canonical = len(subject.scene.body.joints), subject.template.W is not None
    of_last = "metres, canonical pose" if canonical else f"{frame}the last frame"
    ports = {
        "M": Port("M", (d,), "motion features, see the property features"),
        "turn": Port("turn", (3, 3), "v @ turn + shift puts v of the last root frame into this one"),
        "shift": Port("shift", (3,), "metres"),
        "R": Port("R", (j, 3, 3), "R_j x + t_j puts a point x that joint j carries into this root frame"),
        "t": Port("t", (j, 3), "metres; x from the canonical root joint"),
    }
    inputs = [
        Port("h", (config.motion.gru,), "recurrent state"),
        Port("V_prev", (n, 3), f"garment of the last frame before detail, {of_last}"),
        *(ports[name] for name in frame_fields(subject)),
    ]
    outputs = [
        ("V", f"garment, {frame}this frame"),
        ("h_next", "h of the next step"),
        ("V_prev_next", "V_prev of the next step"),
    ]
    return to_onnx(
        step_function(subject, detail),
        inputs,
        outputs,
        name="step",
        opset=opset,
        metadata=_properties(subject),
    )


def _start_graph(subject: StepSubject, opset: int) -> Any:
    T, config = subject.template.T, subject.model.config
    W = np.asarray(jax.jit(lambda T, x: softmax_weights(T, x, tau=config.body.tau))(T, subject.seeds.points))

    ring = subject.template.ring

    def run(rotations: jax.Array):
        # a template carried by the joints is unposed the template
        unposed = subject.template.W is not None
        V = jnp.asarray(T) if unposed else first_frame(subject.scene, subject.seeds, T, W, rotations)
        column_rnn = () if ring is None else (flat(begun(subject.scene, ring, config.column_rnn, rotations)),)
        return jnp.zeros(config.motion.gru), V, *column_rnn

    outputs = [("h", "zeros"), ("V_prev", "the template carried by the body, metres, root frame")]
    outputs += [] if ring is None else [("column_rnn", "state of the column RNN: the template hangs still")]
    properties = _properties(subject)
    return to_onnx(run, _skeleton(subject)[:1], outputs, name="start", opset=opset, metadata=properties)


def _frame_graph(subject: StepSubject, opset: int) -> Any:
    model, pinned = subject.model, subject.scene.pins is not None

    outputs = [
        *((name, "of the step, see there") for name in frame_fields(subject)),
        ("to_world", "world = V @ to_world + root"),
        *([("pins", "the vertices of the property pins on the body, metres, root frame")] if pinned else []),
    ]

    def run(*skeletons: jax.Array):
        frame = frame_input(subject.scene, model.config.body.motion_joints, model.fps, *skeletons)
        return tuple(getattr(frame, name) for name, _ in outputs)

    properties = _properties(subject)
    return to_onnx(run, _skeleton(subject), outputs, name="frame", opset=opset, metadata=properties)


def _column_rnn_graph(subject: StepSubject, opset: int) -> Any:
    ring = subject.template.ring
    assert ring is not None
    n, size = len(subject.template.T), length(ring, subject.model.config.column_rnn)
    inputs = [
        Port("V", (n, 3), "of the step, metres, root frame"),
        Port("column_rnn", (size,), "state of the column RNN, of the last frame"),
        *_skeleton(subject),
    ]
    outputs = [
        ("V_corrected", "V corrected, metres, root frame"),
        ("column_rnn_next", "state of the column RNN, of the next frame"),
    ]
    properties = _properties(subject)
    return to_onnx(
        column_rnn_function(subject), inputs, outputs, name="column_rnn", opset=opset, metadata=properties
    )


def _attach_graph(subject: StepSubject, pins: np.ndarray, opset: int) -> Any:
    garment = subject.scene.garment
    H = jnp.asarray(pin_extension(garment, pins))
    frame = "metres, root frame"
    inputs = [
        Port("V", garment.template.shape, frame),
        Port("pins", (len(pins), 3), f"of the frame graph, {frame}"),
    ]
    outputs = [("V_attached", f"V with its pins there and the cloth beside them along, {frame}")]
    properties = _properties(subject)
    return to_onnx(
        lambda V, positions: (follow(V, positions, pins=pins, extension=H),),
        inputs,
        outputs,
        name="attach",
        opset=opset,
        metadata=properties,
    )


def _skeleton(subject: StepSubject) -> list[Port]:
    joints = (len(subject.scene.body.joints), 3, 3)
    return [
        Port("rotations", joints, "world rotation of each joint from the canonical pose"),
        Port("root", (3,), "world position of joint 0, metres, Y up"),
        Port("rotations_prev", joints, "rotations of the last frame"),
        Port("root_prev", (3,), "root of the last frame"),
    ]


def _properties(subject: StepSubject) -> dict[str, str]:
    """Return what a host must know, as the graph's metadata: JSON but for plain words."""
    model, scene = subject.model, subject.scene
    joints = chosen_joints(scene.body, model.config.body.motion_joints)
    pins = [] if scene.pins is None else scene.pins.vertices.tolist()
    return {
        "schema": SCHEMA,
        "garment": subject.name,
        "garment_hash": model.garment_hash,
        "vertices": str(model.vertices),
        "fps": f"{model.fps:g}",
        "units": "metres, radians, seconds; Y up, right-handed; row vectors",
        "joint_names": json.dumps(scene.body.joint_names),
        "motion_joints": json.dumps(joints),
        "features": json.dumps(feature_names(joints)),
        "pins": json.dumps(pins),
    }
