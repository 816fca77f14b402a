"""A garment of 60 vertices on a map of 32 x 32, the smallest that the discriminator can score."""

from functools import lru_cache

import jax
import jax.numpy as jnp

from garment_jax.config import DetailConfig
from garment_jax.dataset.template import Template, make_template
from garment_jax.model.detail.train_step import DetailBatch, init_players
from tests.reference.small_model import GENERATIVE, fast_key, small_model

CONFIG = DetailConfig(code_features=(8, 6), hidden=12, vertex_code=4, channels=(4, 6, 6, 8))
FRAMES = 4


@lru_cache(maxsize=1)
def small_template() -> Template:
    """Return the template; the same one for every test of a process."""
    model = small_model()
    return make_template(model.scene.garment, model.scene.body, model.template.statistics, uv_size=32)


def small_batch() -> DetailBatch:
    """Return frames that miss a wrinkle of a few mm, which depends on the code and on the vertex."""
    V_star = jnp.asarray(small_model().V[:FRAMES])
    Z = jax.random.normal(fast_key(3), (FRAMES, GENERATIVE.latent_dim))
    phase = 40.0 * V_star[..., :1] + Z[:, :1, None]
    return DetailBatch(V_star - 0.005 * jnp.sin(phase) * jnp.ones((1, 1, 3)), Z, V_star)


def small_players(config: DetailConfig = CONFIG) -> dict[str, dict]:
    """Return fresh parameters of both networks."""
    template = small_template()
    return jax.jit(lambda key: init_players(key, template, config=config, generative=GENERATIVE))(fast_key(1))
