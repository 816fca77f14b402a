"""All baselines by name, in the order of the tables."""

from garment_jax.baselines import ridge, skinned_template
from garment_jax.baselines.method import Method

_ALL = (skinned_template.METHOD, ridge.STATIC, ridge.METHOD)
METHODS: dict[str, Method] = {method.name: method for method in _ALL}
