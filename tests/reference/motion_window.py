"""One window of two lanes of the small model, and one frame of the motion stage for Python loops."""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from garment_jax.config import MotionConfig
from garment_jax.model.generative.network import decode
from garment_jax.model.generative.principal import begin_linear, fit_linear_model
from garment_jax.model.motion.network import MotionCarry, carry_over, init_motion, motion_code, motion_gates
from garment_jax.model.motion.train_step import MotionBatch
from garment_jax.structs import FrameInput
from tests.reference.small_model import GENERATIVE, MOTION, fast_key, small_model

W, LANES = 6, 2


@lru_cache(maxsize=1)
def frozen() -> tuple[dict, np.ndarray]:
    """Return a generative model begun from principal components, and every frame's true code `[t, 8]`."""
    model = small_model()
    params = begin_linear(model.params, model.V, model.T_tilde, template=model.template, config=GENERATIVE)
    return params, fit_linear_model(model.V, model.T_tilde, GENERATIVE.latent_dim).Z


@lru_cache(maxsize=2)
def motion_params(config: MotionConfig = MOTION) -> dict:
    """Return fresh parameters of the motion encoder."""
    return init_motion(fast_key(3), small_model().template, config=config, generative=GENERATIVE)


def window(first: int = 1, *, fresh: bool = True) -> MotionBatch:
    """Return the frames `first ...` of lane 0 and those 15 later of lane 1, begun from true frames."""
    model, Z = small_model(), frozen()[1]
    starts = [first, first + 15]

    def lanes(array: np.ndarray) -> jax.Array:
        return jnp.asarray(np.stack([array[s : s + W] for s in starts], axis=1))

    x = jax.tree.map(lanes, model.input.x)
    V_start = jnp.asarray(np.stack([model.V[s - 1] for s in starts]))
    weight, begun = jnp.ones((W, LANES)), jnp.full(LANES, fresh)
    return MotionBatch(x, lanes(model.V), lanes(Z), weight, begun, V_start)


@partial(jax.jit, static_argnames="config")
def one_frame(
    params: dict, decoder: dict, carry: MotionCarry, x: FrameInput, config: MotionConfig = MOTION
) -> tuple[MotionCarry, jax.Array]:
    """Return the carry after one frame and the frame's code, by the public functions alone."""
    template = small_model().template
    gates = motion_gates(params, x.M, template=template)
    V_prev = carry_over(carry.V_prev, x)
    h, Z = motion_code(
        params, carry.h, V_prev, gates, template=template, config=config, generative=GENERATIVE
    )
    return MotionCarry(h, decode(decoder, Z, template=template, config=GENERATIVE).V), Z
