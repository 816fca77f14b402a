"""Parameters that are not those of the networks that a model's configuration describes."""

from typing import Any

import jax

from garment_jax.dataset.template import Template
from garment_jax.model.store import Model


def check_parameters(model: Model, template: Template) -> None:
    """Raise `ValueError` for an array that the networks of `model` lack or have in another shape.

    It costs the time of tracing the networks' starts. Models of today say when they are read that their
    files belong together; of older ones, and of those changed by hand, this finds what fails to animate.
    """
    found = _shapes(model.params)
    for name, shape in _shapes(_wanted(model, template)).items():
        if name.startswith("generative/E_gen/") and "E_gen" not in model.params["generative"]:
            continue  # left out: only a mesh to begin from needs it
        if name not in found:
            raise ValueError(f"the model's parameters lack {name}, which config.toml asks for; {_REMEDY}")
        if found[name] != shape:
            raise ValueError(
                f"the model's parameter {name} has shape {found[name]}, and config.toml asks for {shape}; "
                f"{_REMEDY}"
            )


_REMEDY = "copy the model again, or save it anew from its run."


def _wanted(model: Model, template: Template) -> dict[str, Any]:
    """Return the shapes of the parameters that the configuration makes, of the parts that the model has."""
    from garment_jax.model.generative.network import init_generative
    from garment_jax.model.motion.network import init_motion

    c, key = model.config, jax.random.key(0)
    made: dict[str, Any] = {
        "generative": lambda: init_generative(key, template, config=c.generative),
        "motion": lambda: init_motion(key, template, config=c.motion, generative=c.generative),
    }
    if "detail" in model.params:
        from garment_jax.model.detail.network import init_detail

        made["detail"] = lambda: init_detail(key, template, config=c.detail, generative=c.generative)
    if "column_rnn" in model.params:
        from garment_jax.model.column_rnn.network import init_column_rnn

        made["column_rnn"] = lambda: init_column_rnn(key, config=c.column_rnn)
    return {part: jax.eval_shape(make) for part, make in made.items()}


def _shapes(tree: Any) -> dict[str, tuple[int, ...]]:
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {jax.tree_util.keystr(path, simple=True, separator="/"): leaf.shape for path, leaf in leaves}
