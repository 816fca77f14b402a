"""A model ready for use: parameters, what it animates, and the tables that all of its frames share."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax

from garment_jax.api.arguments import a_flag, a_path, optional, takes
from garment_jax.api.opened import Opened, Wanted, open_model, read_once
from garment_jax.body.carried import Carried, carried_points
from garment_jax.body.seeds import Seeds
from garment_jax.config import Config
from garment_jax.dataset.template import Template
from garment_jax.io.sequence import open_sequence
from garment_jax.model.scene_file import Sample, read_sample, sample_of
from garment_jax.model.store import Model, facts_of, template_for
from garment_jax.postprocess.scene_tables import contact_tables, limbs_for, shape_tables
from garment_jax.postprocess.tables import Tables
from garment_jax.structs import Motion, Scene


class LoadedModel(NamedTuple):
    """A trained model and what it animates: what every other function of `garment_jax` takes.

    A pytree whose leaves are `params`; all else is static. So it passes through `jax.jit`, `jax.grad` and
    `jax.vmap`, and `model._replace(params=...)` is the model with other parameters.
    """

    name: str
    params: dict  # "generative", "motion" and perhaps "detail" and "column_rnn"
    config: Config
    fps: float  # of the motions that it takes
    scene: Scene  # garment, body, collider, pins; metres, Y up
    motion: Motion  # a sample, to see it with
    template: Template  # what the networks know of the garment
    seeds: Seeds  # points of the body that carry the garment's pose
    tables: Tables  # what pins, lengths and collisions are handled by
    carried: Carried  # what the body carries: pins, collider, limbs
    opened: Opened  # where it was read, and what is compiled of it


@takes(
    model=a_path,
    clip=optional(a_path),
    column_rnn=a_flag,
    detail=a_flag,
    lengths=a_flag,
    untangle=a_flag,
)
def load(
    model: str | Path,
    *,
    clip: str | Path | None = None,
    column_rnn: bool = True,
    detail: bool = True,
    lengths: bool = True,
    untangle: bool = False,
) -> LoadedModel:
    """Return a model: a shipped one by its name ("skirt"), a saved one's folder, or a run of `train`.

    `clip`: a sequence file whose garment, body, pins and motion it takes (default: its own, `scene.h5`).
    `column_rnn`, `detail` and `lengths` off leave these parts out, everywhere; with `untangle` crossings of
    the garment with itself are undone, as part of collision handling. Compiled programs are kept in the
    user's cache folder (`GARMENT_JAX_CACHE=off`: not). Raises `ValueError` or `OSError` in one sentence.

        model = gj.load("skirt")
        model.scene.garment.template    # [n, 3] metres
    """
    opened = open_model(str(model), Wanted(no_lengths=not lengths, untangle=untangle))
    trained = read_once(opened)
    left_out = {name for name, kept in (("column_rnn", column_rnn), ("detail", detail)) if not kept}
    if left_out & set(trained.params):
        params = {name: part for name, part in trained.params.items() if name not in left_out}
        trained = trained._replace(params=params)
        opened = opened._replace(facts=facts_of(trained), models={(): trained})
    sample = _sample(opened.path, clip)
    scene, config = sample.scene, trained.config
    template, seeds = template_for(trained, scene, str(clip or opened.path))
    limbs = limbs_for(config, scene)
    carried = carried_points(scene, collider=scene.collider is not None, limbs=limbs)
    contacts = None
    if untangle and scene.collider is None:
        raise ValueError(f"{opened.path} has no collider, and untangling is part of collision handling.")
    if scene.collider is not None:
        contacts = contact_tables(config, scene, template, carried.pins, limbs)
    return LoadedModel(
        name=Path(opened.path).resolve().name,
        params=trained.params,
        config=config,
        fps=trained.fps,
        scene=scene,
        motion=sample.motion,
        template=template,
        seeds=seeds,
        tables=Tables(shape_tables(config, scene, template, carried.pins), contacts),
        carried=carried,
        opened=opened,
    )


def trained_of(model: LoadedModel) -> Model:
    """Return the parameters and what describes them, as they are now."""
    return read_once(model.opened)._replace(params=model.params, config=model.config)


def opened_of(model: LoadedModel) -> Opened:
    """Return what is open and compiled of a model; nothing, where its parameters were replaced."""
    trained = read_once(model.opened)
    if trained.params is model.params and trained.config is model.config:
        return model.opened
    changed = trained_of(model)
    return model.opened._replace(facts=facts_of(changed), models={(): changed}, animators={})


def _sample(path: str, clip: str | Path | None) -> Sample:
    if clip is not None:
        with open_sequence(clip) as sequence:
            return sample_of(sequence)
    sample = read_sample(path)
    if sample is None:
        raise ValueError(
            f"{path} holds no scene.h5, so its garment and body are not known; name a sequence file of them: "
            'load(..., clip="CLIP.h5").'
        )
    return sample


class _Static:
    """What a compiled program closes over; the same only where every part is the same object."""

    def __init__(self, parts: Sequence[Any]) -> None:
        self.parts = tuple(parts)

    def __hash__(self) -> int:
        return hash(tuple(map(id, self.parts)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Static) or len(self.parts) != len(other.parts):
            return False
        return all(a is b for a, b in zip(self.parts, other.parts, strict=True))


_PARAMS = LoadedModel._fields.index("params")


def _flatten(model: LoadedModel) -> tuple[tuple[dict], _Static]:
    return (model.params,), _Static([part for i, part in enumerate(model) if i != _PARAMS])


def _unflatten(static: _Static, children: Sequence[Any]) -> LoadedModel:
    return LoadedModel(*static.parts[:_PARAMS], *children, *static.parts[_PARAMS:])


jax.tree_util.register_pytree_node(LoadedModel, _flatten, _unflatten)
