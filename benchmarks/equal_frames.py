"""Our codes and swing, Pan's and Santesteban's networks, all learnt from the same simulated frames on a GPU.

    python benchmarks/equal_frames.py known MODEL DATA --out KNOWN
    python benchmarks/equal_frames.py train MODEL CLIP... --known KNOWN --pattern FLAT --cloth ... --out OUT

`known` takes from DATA's training clips what does not hang on the frames to come: Pan's bones, Santesteban's
components, our linearised garment. `train` makes clips out of CLIPs' motions and simulates them as
`swing_from_simulation.py` does (its options; nothing is written but with `--keep`), and then trains, each for
its `--seconds`: our motion encoder (`warm_up`, then `codes` through the decoders), our ring (`swing`), Pan's
two networks (`bones`, `residual`), Santesteban's. Ours go on from MODEL, whose generative model stays; the
others begin anew. Every learning rate falls to 1 % in its seconds; `--set` changes MODEL's configuration.
OUT/ours is a saved model; OUT/pan/model and OUT/santesteban/model are what the baselines load. With
JAX_COMPILATION_CACHE_DIR the steps are compiled beside the simulation. Needs the extra `sim`.
"""

import argparse
import json
import multiprocessing
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import swing_from_simulation as clips_of
from equal_stages import LANES, STAGES, WINDOWS, compiled, make_stages, on_device, places_at
from learnt_frames import Knowledge, begin_worker, find_known, packed
from swing_from_simulation import say

from garment_jax.body.garment_skinning import closest_weights
from garment_jax.machine import machine
from garment_jax.structs import TrainState

SECONDS = {"warm_up": 80, "codes": 70, "swing": 90, "bones": 60, "residual": 25, "santesteban": 60}
RATES = {
    "warm_up": 1e-3,
    "codes": 2e-4,
    "swing": 5e-4,
    "bones": 3e-3,
    "residual": 1.5e-3,
    "santesteban": 3e-3,
}  # the baselines': their search's in docs/results.md
SAVES = 6  # while a stage is trained
FLOOR = 0.01  # of a learning rate, at the end
RISE = 0.02  # of the seconds


def timed(
    name: str,
    step: Callable,
    state: TrainState,
    batch_at: Callable[[int], Any],
    seconds: float,
    save: Callable[[TrainState], None],  # a machine that is lent may be gone before the end
) -> TrainState:
    """Return the state after as many steps as go into `seconds`."""
    import jax
    import jax.numpy as jnp

    rate, k, rmse, saved = RATES[name], 0, [], 1
    state, metrics = step(state, batch_at(0))
    jax.block_until_ready(state)
    began = time.perf_counter()
    while True:
        part = (time.perf_counter() - began) / seconds
        if part >= 1.0:
            break
        falling = FLOOR + (1.0 - FLOOR) * 0.5 * (1.0 + np.cos(np.pi * part))
        now = jnp.float32(rate * min(part / RISE + 1e-2, falling))
        state.opt_state[1].hyperparams["learning_rate"] = now
        k += 1
        state, metrics = step(state, batch_at(k % WINDOWS))
        rmse.append(metrics["rmse_cm"])
        if k % 20 == 0:
            jax.block_until_ready(rmse[-1])
        if part > saved / SAVES or k == 20:
            saved += part > saved / SAVES
            done = time.perf_counter() - began
            say(f"{name}: {k} windows, {float(jnp.stack(rmse[-200:]).mean()):.3f} cm, {done:.0f} s")
            if k > 20:
                save(state)
    mean = float(jnp.stack(rmse[-200:]).mean()) if rmse else np.nan
    say(f"{name}: {k} windows in all, {mean:.3f} cm, {1e3 * seconds / max(k, 1):.1f} ms each")
    save(state)
    return state


def seconds_of(pairs: list[str]) -> dict[str, float]:
    """Return the seconds of each stage; raises `ValueError` for one that is not there or lacks another."""
    given = dict(pair.split("=") for pair in pairs)
    for name in given:
        if name not in STAGES:
            raise ValueError(f"--seconds {name} is no stage; choose from {', '.join(STAGES)}.")
    wanted = SECONDS | {name: float(value) for name, value in given.items()}
    if wanted["residual"] and not wanted["bones"]:
        raise ValueError("--seconds bones=0 leaves the residual nothing to correct; give residual=0, too.")
    return wanted


def train(knowledge: Knowledge, options: argparse.Namespace) -> None:
    """Simulate, train all that is wanted, save."""
    import jax

    from garment_jax.baselines.fitting import own_config
    from garment_jax.rollout.model import Model, save_model
    from garment_jax.swing.tables import seen_body

    wanted = seconds_of(options.seconds)
    aside = None
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        context = multiprocessing.get_context("spawn")
        aside = context.Process(target=compiled, args=(knowledge, wanted, LANES))
        aside.start()
    clips, facts = clips_of.simulated(knowledge, options, begin_worker, packed)
    stages = make_stages(knowledge, wanted)
    lengths = [len(clip.X) for clip in clips]
    data = on_device(clips, knowledge, stages["template"])
    jax.block_until_ready(data)
    del clips
    say(f"{sum(lengths)} frames with mirror images on the device")
    if aside is not None:
        aside.join()
    model, known, scene = knowledge.model, knowledge.known, knowledge.sources.scene
    ours, done = dict(model.params), {}

    def save(name: str, state: TrainState) -> None:
        done[name] = jax.device_get(state.params)
        config = own_config(model.config)
        if name in ("warm_up", "codes", "swing"):
            ours["motion" if name != "swing" else name] = done[name]
            save_model(model._replace(params=ours, seen=seen_body(scene)), options.out / "ours")
            return
        if name == "santesteban":
            fixed = {"basis": known["basis"].astype(np.float32), "mean": known["mean"]}
            fixed |= {"deviation": known["deviation"], "weights": closest_weights(scene)}
            params = {"network": done[name], **fixed}
        else:
            params = {"low": done["bones"], "weights": known["bones"], "mean": known["bone_mean"]}
            params |= {"deviation": known["bone_deviation"]}
            params |= {"high": done["residual"]} if "residual" in done else {}
        folder = options.out / {"bones": "pan", "residual": "pan"}.get(name, name) / "model"
        folder.parent.mkdir(parents=True, exist_ok=True)
        other = Model(config, params, model.statistics, model.garment_hash, model.vertices, model.fps)
        save_model(other, folder, bits=32)

    for name in STAGES:
        if name not in stages:
            continue
        step, begin, batch = stages[name]
        state = begin()
        if name == "codes" and "warm_up" in done:
            params = jax.tree.map(jax.numpy.array, done["warm_up"])
            state = state._replace(params=params)
        make, places = jax.jit(batch), places_at(name, lengths, knowledge)
        more = (done.get("bones", stages["low"]),) if name == "residual" else ()

        def batch_at(k: int, make=make, places=places, more=more) -> Any:
            return make(data, places(k), *more)

        timed(name, step, state, batch_at, wanted[name], partial(save, name))
    say(json.dumps(machine() | facts | {"seconds": wanted, "lanes": LANES, "rates": RATES}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    find = commands.add_parser("known")
    find.add_argument("model", type=Path)
    find.add_argument("data", type=Path)
    find.add_argument("--out", type=Path, required=True)
    go = commands.add_parser("train")
    go.add_argument("model", type=Path)
    go.add_argument("sources", nargs="+", type=Path, metavar="clip")
    go.add_argument("--known", type=Path, required=True)
    go.add_argument("--seconds", nargs="*", default=[], metavar="STAGE=SECONDS")
    go.add_argument("--lanes", type=int, help="of every stage")
    go.add_argument("--set", nargs="*", default=[], metavar="SECTION.KEY=VALUE", help="of the model's config")
    clips_of.add_simulation(go)
    options = parser.parse_args()
    if options.command == "known":
        find_known(options.model, options.data, options.out)
        return
    from garment_jax.config import apply_overrides
    from garment_jax.training.pipeline import trained_model

    if options.lanes:
        LANES.update(dict.fromkeys(LANES, options.lanes))
    model = trained_model(options.model)
    model = model._replace(config=apply_overrides(model.config, [f"--{pair}" for pair in options.set]))
    sources = clips_of.read_sources(options, model.config.swing)
    with np.load(options.known) as stored:
        known = {name: stored[name] for name in stored.files}
    train(Knowledge(sources, model, known), options)


if __name__ == "__main__":
    main()
