"""A trained model on disk: `config.toml`, `model.json`, `parameters.npz` (16 or 32 bits) and `scene.h5`."""

import contextlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from flax.traverse_util import flatten_dict, unflatten_dict

from garment_jax.body.seeds import Seeds, make_seeds
from garment_jax.config import Config, current, from_dict, load_config, to_dict, to_toml
from garment_jax.dataset.motion_input import MotionInput, motion_input
from garment_jax.dataset.start import make_start
from garment_jax.dataset.template import SeenBody, Statistics, Template, read_seen_body, scene_template
from garment_jax.io.content_hash import garment_hash, mesh_hash
from garment_jax.io.formats.npz import npz_names, read_npz
from garment_jax.io.validation import FPS_TOLERANCE, check_poses, check_same_garment
from garment_jax.model.folder import (
    CONFIG,
    FACTS,
    PICTURE,
    arrays_hash,
    check_replaceable,
    check_sizes,
    check_together,
    shaping_of,
    was_interrupted,
    written_together,
)
from garment_jax.model.scene_file import Sample, read_own_garment, write_sample
from garment_jax.structs import Garment, Motion, Scene

# what JSON of other values leads to
_WRONG = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)


class Model(NamedTuple):
    """Trained parameters and what describes them; body, collider and pins come with the clip."""

    config: Config
    params: dict  # "generative", "motion" and perhaps "detail" and "column_rnn"
    statistics: Statistics
    garment_hash: str
    vertices: int
    fps: float
    seen: SeenBody | None = None  # of the column RNN; None: the clip's collider, as before there was this
    garment: Garment | None = None  # trained on; None: only its hash is known


class ModelFacts(NamedTuple):
    """What a scene plan reads of a model: everything but its parameters."""

    config: Config
    parts: frozenset[str]  # trained: the keys of `Model.params`
    vertices: int
    fps: float


def facts_of(model: Model) -> ModelFacts:
    """Return the facts of a model that is loaded."""
    return ModelFacts(model.config, frozenset(model.params), model.vertices, model.fps)


def check_rate(model: Model | ModelFacts, motion: Motion, name: str) -> None:
    """Raise `ValueError` for a motion of another frame rate than the model's."""
    if not abs(motion.fps / model.fps - 1) <= FPS_TOLERANCE:  # NaN, too
        raise ValueError(
            f"{name} has {motion.fps:g} fps and the model was trained at {model.fps:g}; resample the motion "
            f"(garment-jax import --fps {model.fps:g})."
        )


def without_column_rnn(model: Model) -> Model:
    """Return the model that moves by its latents alone; itself without a column RNN."""
    return model._replace(params={k: v for k, v in model.params.items() if k != "column_rnn"})


def garment_misfit(model: Model, garment: Garment) -> str:
    """Return what of `garment` differs from the one that `model` was trained on, a sentence; "" for nothing.

    By value, to 0.1 mm, where the model has its garment: files round it. Else by its hash.
    """
    found = garment_hash(garment)
    if found == model.garment_hash:
        return ""
    if model.garment is None:
        return (
            f"template, faces or UVs have the hash {found}, not {model.garment_hash}; use clips of the same "
            "garment."
        )
    try:
        check_same_garment(model.garment, garment)
    except ValueError as error:
        return str(error)
    return ""


def template_for(model: Model, scene: Scene, name: str) -> tuple[Template, Seeds]:
    """Return the static tables of `scene` for `model`.

    Raises `ValueError` when the scene's garment is not the one that the model was trained on, or hangs on no
    pins, which a column RNN needs (`without_column_rnn` has none).
    """
    n = len(scene.garment.template)
    if n != model.vertices:
        raise ValueError(
            f"{name} has a garment of {n} vertices and the model was trained on {model.vertices}; "
            "use clips of the same garment, or train a model for this one."
        )
    if misfit := garment_misfit(model, scene.garment):
        raise ValueError(f"{name} has another garment than the model was trained on: {misfit}")
    template = scene_template(scene, model.statistics, model.config)
    if "column_rnn" in model.params and model.config.rollout.column_rnn:
        from garment_jax.model.column_rnn.tables import (
            make_column_tables,  # a part that is off is not even imported
        )

        known = model.seen is not None and model.seen.mesh == mesh_hash(scene.body)
        seen = model.seen if known else None  # numbers of another body's vertices would say nothing
        try:
            ring = make_column_tables(scene, config=model.config.column_rnn, seen=seen)
            template = template._replace(ring=ring)
        except ValueError as error:
            raise ValueError(
                f"{name} has a garment whose pins do not lie around the body, or with parts that hang on "
                "none, as the model's column RNN needs them; give a clip with such pins, or leave it out "
                "(--no-column-rnn, in Python animation.without_column_rnn)."
            ) from error
    return template, make_seeds(scene, model.config.body.seeds)


def model_input(model: Model, scene: Scene, template: Template, seeds: Seeds, motion: Motion) -> MotionInput:
    """Return what a rollout of `model` reads of `motion`; `template` and `seeds` are from `template_for`.

    Seeds are posed in frame 0 alone. Raises `ValueError` for a joint that the body lacks, and for a motion
    that is not finite.
    """
    check_poses(motion, "the motion", joints=scene.body.joint_names)
    inputs = motion_input(motion, scene, seeds, model.config.body.motion_joints, seed_frames=1)
    if template.ring is None:
        return inputs
    from garment_jax.model.column_rnn.motion import column_frames

    frames = column_frames(motion, scene, template.ring)
    return inputs._replace(x=inputs.x._replace(column_rnn=frames))


def skinned_template(
    model: Model, template: Template, seeds: Seeds, inputs: MotionInput, *, frame: int = 0
) -> jax.Array:
    """Return the template at `frame`, `[n, 3]` metres, in the networks' frame: a rollout's start."""
    start = make_start(template, seeds, model.config.body.tau)
    return start(inputs.R_seed[frame : frame + 1], inputs.t_seed[frame : frame + 1])[0]


def save_model(
    model: Model,
    folder: str | Path,
    *,
    bits: int = 16,
    sample: Sample | None = None,
    picture: bytes | None = None,
    source: str = "the model",
) -> Path:
    """Write `model` into `folder`, all files or none; return the folder.

    `sample` is what it animates, and a motion to see it with: a model with it runs alone. `picture` is a PNG
    of it. `source` is where the parameters come from, for what is said of them.
    A model of the same garment there is replaced, and what was measured with it removed. Raises
    `ValueError` for a parameter that 16 bits cannot hold, a scene of another garment, and for a folder that
    holds anything else (a run, a model of another garment), `OSError` where the disk is full.
    """
    folder = Path(folder)
    check_replaceable(folder, model.garment_hash)
    arrays = {name: _stored(name, x, bits, source) for name, x in flatten_dict(model.params, sep="/").items()}
    arrays |= {f"statistics/{k}": np.asarray(v) for k, v in model.statistics._asdict().items()}
    facts = {"garment_hash": model.garment_hash, "vertices": model.vertices, "fps": model.fps, "bits": bits}
    facts["shaping"] = shaping_of(to_dict(model.config))
    facts["arrays"] = arrays_hash({name: array.shape for name, array in arrays.items()})
    facts |= {} if model.seen is None else {"seen": model.seen.described()}
    if sample is not None and (misfit := garment_misfit(model, sample.scene.garment)):
        raise ValueError(f"the scene {sample.name} has another garment than the model: {misfit}")
    texts = {CONFIG: to_toml(model.config), FACTS: json.dumps(facts)}
    try:
        with written_together(folder) as partial:
            check_replaceable(folder, model.garment_hash)  # by now another process may have saved there
            np.savez_compressed(partial / "parameters.npz", **arrays)  # type: ignore[arg-type]
            for name, text in texts.items():
                (partial / name).write_text(text + "\n", encoding="utf-8")
            if sample is not None:
                write_sample(partial, sample)
            if picture is not None:
                (partial / PICTURE).write_bytes(picture)
    except OSError as error:
        if error.strerror is None:  # a sentence already
            raise
        raise OSError(
            f"{folder} could not be written ({error.strerror}); free some space or choose another folder."
        ) from error
    return folder


def _stored(name: str, x: Any, bits: int, source: str) -> np.ndarray:
    """Return a parameter in the type that it is stored in."""
    with np.errstate(over="ignore"):
        stored = np.asarray(x).astype(np.float16 if bits == 16 else np.float32)
    if not np.isfinite(stored).all():
        largest = np.abs(np.asarray(x)).max()
        raise ValueError(
            f"parameter {name} of {source} reaches {largest:.3g}, which {bits} bits cannot hold; "
            "save it with --bits 32 or train it again."
        )
    return stored


def check_single_precision() -> None:
    """Raise `ValueError` where JAX is told to compute in 64 bits: models are of 32."""
    if jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError(
            "jax_enable_x64 is on, and models compute in 32 bits; switch it off (unset JAX_ENABLE_X64, or "
            'jax.config.update("jax_enable_x64", False)).'
        )


def load_model(folder: str | Path, *, leave_out: Sequence[str] = ()) -> Model:
    """Read a model that `save_model` wrote, parameters as float32.

    Parameters whose name begins with one of `leave_out` ("detail", "generative/E_gen") are not read. Raises
    `FileNotFoundError` or `ValueError` in one sentence for a folder that holds none or a part.
    """
    check_single_precision()
    config, facts = _described(Path(folder))
    skipped = tuple(f"{name}/" for name in leave_out)
    with _damaged(folder):
        path = Path(folder) / "parameters.npz"
        wanted = {_present(name): name for name in npz_names(path)}
        wanted = {name: stored for name, stored in wanted.items() if not name.startswith(skipped)}
        found = read_npz(path, list(wanted.values()))
        arrays = {name: found[stored] for name, stored in wanted.items()}
        for name, array in arrays.items():
            _check_numbers(name, array)
        statistics = Statistics(*(arrays.pop(f"statistics/{name}") for name in Statistics._fields))
        _check_statistics(statistics)
        described = facts["garment_hash"], facts["vertices"], facts["fps"], read_seen_body(facts.get("seen"))
        # widened on the host, and no `jnp.asarray`: jax would compile a program for every shape
        placed = {name: jax.device_put(np.asarray(x, np.float32)) for name, x in arrays.items()}
        params = unflatten_dict(placed, sep="/")
        return Model(config, params, statistics, *described, garment=read_own_garment(folder))


def _present(name: str) -> str:
    """Return the name of a stored array, whose part may have had another name when it was stored."""
    part, slash, rest = name.partition("/")
    return current(part) + slash + rest


def _check_numbers(name: str, array: np.ndarray) -> None:
    if array.dtype.kind != "f":
        raise ValueError(f"parameter {name} holds {array.dtype}, no real numbers")
    if not np.isfinite(array).all():
        raise ValueError(f"parameter {name} holds NaN or infinite values")


def _check_statistics(statistics: Statistics) -> None:
    for name, array in statistics._asdict().items():
        wanted = statistics.motion_mean.shape if name.startswith("motion") else (3,)
        if array.shape != wanted or array.ndim != 1:
            raise ValueError(f"statistics/{name} has shape {array.shape}, not {wanted}")


def model_facts(folder: str | Path) -> ModelFacts:
    """Return what a saved model says about itself, its parameters unread; raises as `load_model`."""
    config, facts = _described(Path(folder))
    with _damaged(folder):
        parts = {_present(name).split("/")[0] for name in npz_names(Path(folder) / "parameters.npz")} - {
            "statistics"
        }
        return ModelFacts(config, frozenset(parts), facts["vertices"], facts["fps"])


def _described(folder: Path) -> tuple[Config, dict[str, Any]]:
    """Return configuration and facts of a saved model whose three files belong to each other."""
    for name in (CONFIG, "model.json", "parameters.npz"):
        if not (folder / name).is_file():
            if was_interrupted(folder):
                raise FileNotFoundError(
                    f"{folder} holds no {FACTS}, since saving into it was interrupted; run the same "
                    "garment-jax save again."
                )
            if (folder / "checkpoints").is_dir():
                raise FileNotFoundError(
                    f"{folder} is a run of train.py and not yet a model; run garment-jax save {folder} --out "
                    "MODEL first, or read it with garment_jax.load."
                )
            raise FileNotFoundError(
                f"{folder} holds no {name}; name a run of train.py or a model such as models/skirt."
            )
    config = load_config(folder / CONFIG)
    with _damaged(folder):
        facts = json.loads((folder / FACTS).read_text(encoding="utf-8"))
        _check_facts(facts, FACTS)
        check_sizes(to_dict(config))
        check_together(facts, to_dict(config), folder / "parameters.npz")
        return config, facts


def _check_facts(facts: Any, file: str) -> None:
    if not isinstance(facts, dict):
        raise ValueError(f"{file} holds no facts")
    vertices, fps = facts.get("vertices"), facts.get("fps")
    for name, value, right in (
        ("garment_hash", facts.get("garment_hash"), isinstance(facts.get("garment_hash"), str)),
        ("vertices", vertices, isinstance(vertices, int) and vertices > 0),
        ("fps", fps, isinstance(fps, int | float) and 0 < fps < 10_000),
    ):
        if not right:
            raise ValueError(f"{file} has {name} = {value!r}")


@contextlib.contextmanager
def _damaged(folder: str | Path) -> Iterator[None]:
    """Turn what reading a damaged file raises into one sentence."""
    try:
        yield
    except (*_WRONG, OSError) as error:
        raise ValueError(f"{folder} holds a damaged model ({error}); copy or save it again.") from error


def from_metadata(metadata: dict[str, Any], params: dict, source: str | Path) -> Model:
    """Return the model that the metadata of a checkpoint in the folder `source` describe."""
    try:
        statistics = Statistics(
            *(np.array(metadata["statistics"][k], np.float32) for k in Statistics._fields)
        )
        _check_statistics(statistics)
        _check_facts(metadata, "metadata.json")
        config = from_dict(metadata["config"], source="metadata.json")
        described = metadata["garment_hash"], metadata["vertices"], metadata["fps"]
        return Model(config, params, statistics, *described, read_seen_body(metadata.get("seen")))
    except _WRONG as error:
        raise ValueError(
            f"{source} holds a damaged checkpoint ({error}); delete it to go on from the one before."
        ) from error
