"""Has anything become slow? Ratios of times within one run, each with its bound.

    python benchmarks/regressions.py [--json FILE]          # or `make check-speed`

Exits with 1 where one is broken. No clip and no trained model: the embedded garment's UV square as a grid of
9,352 vertices, random parameters, UV 128 x 128; the solver on 2,800. A ratio within one run changes less from
machine to machine than a time does; run it on an idle one all the same. The bounds leave room for what
differs between runs on a shared machine (`docs/performance.md`).
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from counts import frame_work, parameter_bytes
from machine_rates import matmul_rate, read_rate
from pipeline_speed import CHUNK, collision_samples, network_samples
from sized import Case, dressed, make_case, sized_config
from up_convolution import decoder_ratios, measured

from garment_jax.bench.figures import report
from garment_jax.body.carried import carried_points, pose_carried
from garment_jax.structs import Motion, Scene

FRAMES, COPIES = 128, 16
DECODERS = ("UV 128", "UV 64, batch of 48")  # one frame at UV 64 is too short: 0.57 to 0.83 on one machine
TIGHT, WIDE = 0.9, 1.5  # the garment's width for the solver, of the template's: in the body, clear of it


def of_limit(case: Case, chunk_ms: float) -> float:
    """Return which part of the machine's limit a frame reaches, as in `pipeline_speed.py`."""
    flops, memory = matmul_rate(), read_rate(parameter_bytes(case.params))
    work = frame_work(case.params, case.template, case.config).values()
    return 1e3 * sum(max(w.flops / flops, w.bytes / memory) for w in work) / chunk_ms


def free_over_contact(case: Case) -> float:
    """Return the solver's time for a frame without contact, of one with."""
    wide, tight = (case._replace(V=case.V * np.array([s, 1.0, s], np.float32)) for s in (WIDE, TIGHT))
    (free, touched), (contact, touching) = (collision_samples(c, whole_body=False) for c in (wide, tight))
    if touched or not touching:
        sys.exit(f"wrong cases: {touched:.0%} of the wide frames touch, {touching:.0%} of the tight ones")
    return float(np.median(free) / np.median(contact))


def turning_on(scene: Scene, motion: Motion) -> float:
    """Return which part of a processor this process takes while it waits, just after the body was posed."""
    carried = carried_points(scene, collider=True)
    used, waited = 0.0, 0.0
    time.sleep(0.5)  # what made the scene may have left threads turning as well
    for start in range(0, FRAMES - CHUNK + 1, CHUNK):
        pose_carried(carried, scene, motion, slice(start, start + CHUNK))
        processor, began = time.process_time(), time.perf_counter()
        time.sleep(0.02)
        used, waited = used + time.process_time() - processor, waited + time.perf_counter() - began
    return used / waited


def judged(name: str, value: float, *, at_most: float | None = None, at_least: float | None = None) -> dict:
    """Return a row with its verdict."""
    held = (at_most is None or value <= at_most) and (at_least is None or value >= at_least)
    bound = f"<= {at_most}" if at_most is not None else f">= {at_least}"
    return {"ratio": name, "value": float(value), "bound": bound, "verdict": "holds" if held else "SLOW"}


def rows() -> list[dict]:
    """Measure every ratio."""
    scene, motion = dressed(None, FRAMES)
    idle = turning_on(scene, motion)  # before anything else leaves threads turning
    case = make_case(scene, motion, vertices=9_352, config=sized_config(128))
    small = make_case(scene, motion, vertices=2_800, config=sized_config(64))
    chunk = float(np.median(network_samples(case)))
    batch = float(np.median(network_samples(case, copies=COPIES))) / COPIES
    found = [
        judged("networks: the machine's limit / a frame", of_limit(case, chunk), at_least=0.25),
        judged(f"networks: frames/s of {COPIES} motions / of one", chunk / batch, at_least=1.1),
        judged("solver: a frame without contact / with", free_over_contact(small), at_most=0.3),
        judged("posing the body: processors busy after it", idle, at_most=0.2),
    ]
    decoders = decoder_ratios(measured())
    return found + [judged(f"up-convolutions / transposed, {d}", decoders[d], at_most=0.95) for d in DECODERS]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = rows()
    report(found, title="Regressions", facts={}, json_path=options.json)
    sys.exit(any(row["verdict"] == "SLOW" for row in found))


if __name__ == "__main__":
    main()
