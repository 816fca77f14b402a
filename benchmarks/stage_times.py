"""Milliseconds of every stage of a frame by itself, each in a scan of frames as in a rollout."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from machine_rates import median_seconds
from sized import Case

from garment_jax.geometry.uv_maps import from_map
from garment_jax.model.detail.network import enhance
from garment_jax.model.generative.network import networks, position_map
from garment_jax.model.motion.network import gates_of, gru_step, state_encoder

FRAMES = 32


def stages(case: Case) -> dict[str, tuple[Callable, jax.Array, dict]]:
    """Return each stage by the names of `counts.frame_work`: function (x, params), x, params."""
    config, template, params = case.config, case.template, case.params
    g, m = params["generative"], params["motion"]
    size, V = config.uv.size, jnp.asarray(template.T)
    modules = networks(config.generative, len(V), size)
    encoder = state_encoder(config.motion, config.generative, size)
    part = jnp.ones(config.generative.part_dim)
    motion = jnp.ones(case.x.M.shape[1])
    Z = jnp.ones(config.generative.latent_dim)
    S = jnp.ones((size, size, 3)) + jax.random.normal(jax.random.key(1), (size, size, 3))

    def recurrent(x: jax.Array, params: dict) -> jax.Array:
        h = gru_step(params, jnp.broadcast_to(x[:1], (config.motion.gru,)), gates_of(params, x))
        both = jnp.concatenate([h, jnp.ones(config.motion.state_dim)])
        return both @ params["fc"]["kernel"]

    def network(name: str) -> Callable:
        return lambda x, params: modules[name].apply({"params": params}, x)

    listed = {
        "E_m, fc": (recurrent, motion, {k: v for k, v in m.items() if k != "E_s"}),
        "vertices to map": (lambda V, _: position_map(V, template), V, {}),
        "E_s": (lambda S, params: encoder.apply({"params": params}, S), S, m["E_s"]),
        "D_rec": (network("D_rec"), part, g["D_rec"]),
        "D_dyn": (network("D_dyn"), part, g["D_dyn"]),
        "map to vertices": (lambda S, _: from_map(S, template.atlas), S, {}),
    }
    if "detail" in params:
        enhanced = lambda V, params: enhance(params, V, Z, template=template, config=config.detail)  # noqa: E731
        listed["detail"] = (enhanced, V, params["detail"])
    return listed


def milliseconds(f: Callable, x: jax.Array, params: dict) -> float:
    """Return the milliseconds of `f(x, params)`, one after the other: each waits for the one before."""

    def run(x: jax.Array, params: dict) -> tuple[jax.Array, jax.Array]:
        def frame(x: jax.Array, _):
            y = f(x, params)
            # every output is kept, or the compiler would leave out what makes it
            return 0.999 * x + 1e-9 * y.ravel()[:1].reshape((1,) * x.ndim), y

        return jax.lax.scan(frame, x, None, length=FRAMES)

    return 1e3 * median_seconds(jax.jit(run), x, params) / FRAMES
