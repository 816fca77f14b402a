"""What training over several devices costs: reductions of a step, and what to expect of more devices.

    python benchmarks/devices.py [--config configs/skirt.toml] [--steps 4] [--json FILE]
    python benchmarks/devices.py --config configs/paper.toml --motion.lanes=2 \\
        --gpu docs/figures/paper_steps_gpu.json

Every stage takes a few steps on one device and on two of this process, on the scene of
benchmarks/stage_steps.py. The all-reduces and their bytes are counted in the program that XLA compiled for
two. Two devices on the cores of one cannot be faster: the seconds say what splitting costs. With `--gpu`,
step times that were measured on one GPU, the share of the time is estimated that 8 GPUs of one host, and 8
on 4 hosts, spend on their work, each with the whole batch of that measurement: seconds / (seconds +
reductions). A ring sends 2 (N - 1) / N times the bytes over its slowest link and waits 2 (N - 1) times for
it; nothing overlaps.
"""

import argparse
import json
import math
import os
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_force_host_platform_device_count=2"

import jax
from jax.sharding import AxisType

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # the scene made in code lives with the tests
from benchmarks.stage_steps import few_steps, stage_speeds
from garment_jax.bench.figures import report
from garment_jax.config import load_config
from garment_jax.training.devices import AXIS, Devices
from tests.reference.scene import make_motion, make_scene, write_clip

# bytes a second and seconds, of a link: NVLink within a host, 200 Gb/s Ethernet or InfiniBand between hosts
LINKS = {"8 on 1 host": (8, 300e9, 10e-6), "8 on 4 hosts": (8, 25e9, 30e-6)}
BYTES = {"f32": 4, "f16": 2, "bf16": 2, "s32": 4, "u32": 4, "pred": 1}


class Counted(Devices):
    """Devices that note the reductions of each program that they make."""

    noted: list[tuple[int, int]] = []  # noqa: RUF012

    def step(self, step_fn: Any, state: Any) -> Any:
        """Return the step as `Devices` has it, compiled when it is first called."""
        made: list[Any] = []
        jitted = super().step(step_fn, state)

        def call(state: Any, batch: Any) -> Any:
            if not made:
                made.append(jitted.lower(state, batch).compile())
                self.noted.append(reductions(made[0].as_text()))
            return made[0](state, batch)

        return call


def reductions(program: str) -> tuple[int, int]:
    """Return how many all-reduces a step makes, and of how many bytes; in loops as often as they turn."""
    blocks: dict[str, list[str]] = {}
    entry = name = ""
    for line in program.splitlines():
        if opened := re.match(r"(ENTRY )?%?([\w.\-]+) .*\{$", line):
            name = opened[2]
            entry = name if opened[1] else entry
            blocks[name] = []
        elif name:
            blocks[name].append(line)

    def within(name: str) -> tuple[int, int]:
        count = size = 0
        for line in blocks.get(name, []):
            if found := re.search(r"= (.*?) all-reduce(?:-start)?\(", line):
                count += 1
                for kind, shape in re.findall(r"(\w+)\[([\d,]*)\]", found[1]):
                    size += BYTES.get(kind, 4) * math.prod(int(d) for d in shape.split(",") if d)
                continue
            turns = 1
            if " while(" in line and (trips := re.search(r"known_trip_count\D*?(\d+)", line)):
                turns = int(trips[1])
            for called in re.findall(
                r"(?:body|calls|to_apply|true_computation|false_computation)=%?([\w.\-]+)", line
            ):
                more, bytes_ = within(called)
                count, size = count + turns * more, size + turns * bytes_
        return count, size

    return within(entry)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=Path("configs/skirt.toml"))
    parser.add_argument("--steps", type=int, default=4)
    parser.add_argument("--vertices", type=int, nargs=2, default=(25, 112), metavar=("RINGS", "COLUMNS"))
    parser.add_argument("--gpu", type=Path, help="JSON of benchmarks/stage_steps.py, run on one GPU")
    parser.add_argument("--json", type=Path)
    options, overrides = parser.parse_known_args()
    config = few_steps(load_config(options.config, overrides), options.steps, log_every=1)
    config = replace(config, data=replace(config.data, validation=()))
    mesh = jax.make_mesh((2,), (AXIS,), axis_types=(AxisType.Auto,), devices=jax.devices())
    on_gpu = (
        {row["stage"]: row["s/step"] for row in json.loads(options.gpu.read_text())["rows"]}
        if options.gpu
        else {}
    )
    scene = make_scene(*options.vertices)
    with tempfile.TemporaryDirectory() as name:
        data = Path(name) / "data"
        motion = make_motion(scene, 120)
        write_clip(data / "train" / "dance.h5", scene=scene, motion=motion, attributes={"name": "dance"})
        two = Counted(mesh)
        rows_one = [] if on_gpu else stage_speeds(config, data, Path(name) / "one")
        rows_two = stage_speeds(config, data, Path(name) / "two", devices=two)
    rows = []
    for k, ((count, size), row) in enumerate(zip(two.noted, rows_two, strict=True)):
        made = {"stage": row["stage"], "reductions": count, "KB": size / 1e3}
        if rows_one:
            made |= {"s/step on 1": rows_one[k]["s/step"], "s/step on 2": row["s/step"]}
        for where, (n, rate, wait) in LINKS.items():
            if row["stage"] in on_gpu:
                alone = on_gpu[row["stage"]]
                spent = count * 2 * (n - 1) * wait + 2 * (n - 1) / n * size / rate
                made[f"{where}, %"] = 100 * alone / (alone + spent)
        rows.append(made)
    report(rows, title="Steps over devices", facts={"config": str(options.config)}, json_path=options.json)


if __name__ == "__main__":
    main()
