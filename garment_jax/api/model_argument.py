"""The model that most functions of the API take first: what `load` returns, which knows `arguments`."""

from typing import TYPE_CHECKING, Any

from garment_jax.api.arguments import shown

if TYPE_CHECKING:
    from garment_jax.api.loaded import LoadedModel


def a_model(name: str, value: Any) -> "LoadedModel":
    """Return a loaded model. A name is not loaded here: that would be done anew in every call."""
    from garment_jax.api.loaded import LoadedModel

    if not isinstance(value, LoadedModel):
        loads = f"gj.load({value!r})" if isinstance(value, str) else 'gj.load("skirt")'
        raise ValueError(f"{name}={shown(value)} is no loaded model; give what {loads} returns.")
    return value
