"""Rollout and train step against the same networks in PyTorch, in one process on the same cores.

    python benchmarks/against_pytorch.py [--vertices 9352] [--uv 128] [--batch 16] [--no-compile] [--no-train]
        [--clip CLIP.h5] [--json FILE]

Same parameters, same shapes; both programs must give the same garment before anything is timed. JAX runs
compiled chunks of 32 frames and, as PyTorch, one frame a call ("step"); PyTorch runs eagerly and, where a C++
compiler is there, under torch.compile. Rounds of each in turn, medians. The train step is the generative
model's: loss, gradients, clipping, AdamW. PyTorch is not installed with the package (`pip install torch`).
"""

import argparse
import importlib.util
import sys
import time
from collections.abc import Callable
from functools import partial
from operator import itemgetter
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from sized import Case, dressed, make_case, sized_config

from garment_jax.bench.figures import report
from garment_jax.model.compose import step
from garment_jax.model.generative.train_step import GenerativeBatch, make_generative_train_step
from garment_jax.model.scan import make_rollout
from garment_jax.structs import FrameInput, TrainState
from garment_jax.training.optimiser import make_optimiser

FRAMES, ROUNDS, STEPS = 32, 5, 3
AGREE = 1e-5  # metres, after four frames: float32 in another order


def in_turn(ways: dict[str, Callable[[], None]], *, rounds: int = ROUNDS) -> dict[str, float]:
    """Return the median seconds of every way, one after the other in each round; the first calls compile."""
    for way in ways.values():
        way()
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            time.sleep(0.1)  # threads of the one before it stop spinning
            began = time.perf_counter()
            way()
            taken[name].append(time.perf_counter() - began)
    return {name: float(np.median(seconds)) for name, seconds in taken.items()}


def frames_of(x: FrameInput) -> FrameInput:
    return jax.tree.map(lambda leaf: leaf[:FRAMES], x)


def jax_rollouts(case: Case) -> dict[str, Callable]:
    """Return functions that roll out `FRAMES` frames; each returns the garments."""
    x, run = frames_of(case.x), make_rollout(case.template, case.config)
    one = jax.jit(partial(step, template=case.template, config=case.config))

    def chunk() -> np.ndarray:
        return np.asarray(run(case.params, case.start, x)[1])

    def steps() -> np.ndarray:
        state, V = case.start, []
        for t in range(FRAMES):
            state, v = one(case.params, state, jax.tree.map(itemgetter(t), x))
            V.append(np.asarray(v))
        return np.stack(V)

    return {"garment_jax, chunk": chunk, "garment_jax, step": steps}


def torch_rollouts(case: Case, *, compiled: bool) -> dict[str, Callable]:
    import torch
    from pytorch_peer import Garment, tensor

    model = Garment(case.params, case.template, case.config).eval()
    M, turn, shift = (tensor(leaf) for leaf in frames_of(case.x)[:3])

    def rollout(frame: Callable) -> np.ndarray:
        h, V = (tensor(leaf)[None] for leaf in case.start.motion)
        found = []
        with torch.inference_mode():
            for t in range(FRAMES):
                h, V, V_f = frame(h, V, M[t : t + 1], turn[t : t + 1], shift[t : t + 1])
                found.append(V_f[0].numpy())
        return np.stack(found)

    ways = {"PyTorch, eager": partial(rollout, model.frame)}
    if compiled:
        ways["PyTorch, compiled"] = partial(rollout, torch.compile(model.frame, dynamic=False))
    return ways


def train_steps(case: Case, batch: int, *, compiled: bool) -> dict[str, Callable]:
    """Return functions that take `STEPS` train steps of the generative model each."""
    import torch
    from pytorch_peer import Garment, tensor

    config, n = case.config, len(case.template.T)
    rng = np.random.default_rng(0)
    V = (case.template.T + 0.02 * rng.normal(size=(batch, n, 3))).astype(np.float32)
    unposed = (case.template.T + 0.02 * rng.normal(size=(batch, n, 3))).astype(np.float32)
    rate, decay = config.generative.learning_rate, config.generative.weight_decay
    optimiser = make_optimiser(config.training, learning_rate=rate, weight_decay=decay, steps=1000)
    take = make_generative_train_step(case.template, config.generative, optimiser)
    own = jax.tree.map(jnp.array, case.params["generative"])  # its buffers are given away
    known = [TrainState(own, optimiser.init(own), jax.random.key(0), jnp.zeros((), jnp.int32))]
    model = Garment(case.params, case.template, config)
    trained = [
        p for name, p in model.named_parameters() if name.split(".")[0] in ("E_gen", "split_s", "split_d")
    ]
    trained += [*model.D_rec.parameters(), *model.D_dyn.parameters()]
    adam = torch.optim.AdamW(trained, lr=rate, weight_decay=decay)
    targets, unposed_targets = tensor(V), tensor(unposed)
    loss_of = torch.compile(model.generative_loss, dynamic=False) if compiled else None

    def with_jax() -> None:
        for _ in range(STEPS):
            known[0], metrics = take(known[0], GenerativeBatch(V, unposed))
        jax.block_until_ready((known[0].params, metrics))

    def with_torch(loss: Callable) -> None:
        for _ in range(STEPS):
            adam.zero_grad(set_to_none=True)
            noise = torch.randn(batch, config.generative.latent_dim)
            loss(targets, unposed_targets, noise).backward()
            torch.nn.utils.clip_grad_norm_(trained, config.training.clip_norm)
            adam.step()

    ways = {"garment_jax": with_jax, "PyTorch, eager": partial(with_torch, model.generative_loss)}
    if loss_of is not None:
        ways["PyTorch, compiled"] = partial(with_torch, loss_of)
    return ways


def rows_of(title: str, seconds: dict[str, float], *, per: int, own: str) -> list[dict]:
    """Return a row for every way: milliseconds of one of `per`, and `own`'s time as a part of it."""
    return [
        {"what": title, "way": name, "ms": 1e3 * taken / per, "ratio": seconds[own] / taken}
        for name, taken in seconds.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vertices", type=int, default=9352)
    parser.add_argument("--uv", type=int, default=128)
    parser.add_argument("--rank", type=int, default=0)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--clip", type=Path)
    parser.add_argument("--no-compile", action="store_true")
    parser.add_argument("--no-train", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if importlib.util.find_spec("torch") is None:
        print("error: PyTorch is not installed; pip install torch and run this again.", file=sys.stderr)
        sys.exit(2)
    import torch

    scene, motion = dressed(options.clip, FRAMES)
    config = sized_config(options.uv, rank=options.rank)
    case = make_case(scene, motion, vertices=options.vertices, config=config)
    compiled = not options.no_compile
    ways = jax_rollouts(case) | torch_rollouts(case, compiled=compiled)
    garments = {name: way()[:4] for name, way in ways.items()}
    first = garments["garment_jax, chunk"]
    apart = max(float(np.abs(V - first).max()) for V in garments.values())
    if not apart <= AGREE:
        print(
            f"error: the programs differ by {apart:g} m after 4 frames; nothing was timed.", file=sys.stderr
        )
        sys.exit(1)
    rows = rows_of("rollout, a frame", in_turn(ways), per=FRAMES, own="garment_jax, chunk")
    if not options.no_train:
        ways = train_steps(case, options.batch, compiled=compiled)
        rows += rows_of(
            f"train step, batch of {options.batch}", in_turn(ways, rounds=3), per=STEPS, own="garment_jax"
        )
    facts = {
        "vertices": len(case.template.T),
        "UV": options.uv,
        "rank": options.rank or "whole",
        "PyTorch": torch.__version__,
        "its threads": torch.get_num_threads(),
        "apart m": apart,
    }
    report(rows, title="Against PyTorch", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
