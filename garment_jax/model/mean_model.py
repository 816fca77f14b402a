"""Several models as one: the mean of their parameters, at the run time of one."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.model.store import Model, without_column_rnn


def mean_model(models: Sequence[Model], names: Sequence[str]) -> Model:
    """Return a model with the mean of all parameters and the first one's configuration.

    The column RNN is the first one's: two that began afresh have nothing in common. For models that were
    trained on from one (`training.begin_from`), and that one: the mean may err by less
    than each on what none has seen (Wortsman et al. 2022, "Model soups"; not in the paper). Measure it on
    clips kept back. Of models that began apart it is no model at all. Raises `ValueError`,
    with the names, for models of different garments, frame rates or statistics, which have no common
    beginning, and of different stages or shapes.
    """

    def latents(model: Model) -> dict:
        return without_column_rnn(model).params

    first = models[0]
    for model, name in zip(models[1:], names[1:], strict=True):
        facts = ("garment_hash", "vertices", "fps")
        odd = next((key for key in facts if getattr(model, key) != getattr(first, key)), None)
        pairs = zip(first.statistics, model.statistics, strict=True)
        if odd is None and not all(np.allclose(a, b, rtol=1e-6) for a, b in pairs):
            odd = "statistics"
        if odd is None and jax.tree.map(jnp.shape, latents(model)) != jax.tree.map(jnp.shape, latents(first)):
            odd = "stages or widths"
        if odd is not None:
            raise ValueError(
                f"{name} has other {odd} than {names[0]}; a mean is of models that began from one "
                "(training.begin_from)."
            )
    # on the host: jax would compile a sum and a quotient for every shape
    mean = jax.tree.map(
        lambda *leaves: jax.device_put(sum(map(np.asarray, leaves)) / np.float32(len(leaves))),
        *(latents(model) for model in models),
    )
    return first._replace(params=first.params | mean)
