"""All baselines by name, in the order of the tables."""

from garment_jax.baselines import pan, ridge, santesteban, skinned_template, ssdr_linear, vertex_decoder
from garment_jax.baselines.method import Method

_ALL = (
    skinned_template.METHOD,
    ridge.STATIC,
    ridge.METHOD,
    santesteban.METHOD,
    pan.METHOD,
    ssdr_linear.METHOD,
    vertex_decoder.METHOD,
)
METHODS: dict[str, Method] = {method.name: method for method in _ALL}
