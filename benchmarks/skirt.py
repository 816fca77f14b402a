"""Error beside run time of a trained model on the test clips, with and without its parts.

    python benchmarks/skirt.py models/skirt data/skirt/test --json docs/figures/skirt.json

Every clip begins from the skinned template; the truth is only compared with. Rows: the whole model, parts
left out, further runs given with --also NAME=RUN (such as the ablation without the previous state), the
reconstruction of the truth by the auto-encoder, and the skinned template. Milliseconds a frame are single
stream: whole rollouts through `animate` (posing of pins and collider included), the median over the chunks of
all clips but each one's first two. The first compiles, and while it does the second is worked out.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np

from garment_jax.animation.animate import animate
from garment_jax.animation.variants import untangled, without_lengths
from garment_jax.bench.methods import reconstructed
from garment_jax.body.root_frame import to_root
from garment_jax.dataset.motion_input import motion_input
from garment_jax.dataset.start import make_skinned_template
from garment_jax.evaluation.rmse import rmse
from garment_jax.io.sequence import open_sequence
from garment_jax.machine import machine
from garment_jax.model.store import Model, template_for, without_column_rnn
from garment_jax.training.pipeline import trained_model


class Clip:
    """A test clip in memory: scene, motion, truth."""

    def __init__(self, path: Path) -> None:
        with open_sequence(path) as sequence:
            self.scene, self.motion, self.name = sequence.scene, sequence.motion, sequence.name
            self.V = sequence.read(0, sequence.frames)


def rolled_out(model: Model, clip: Clip, **options) -> tuple[float, list[float]]:
    """Return RMSE (cm) and milliseconds a frame of a rollout's whole chunks from the third on."""
    pieces, times, began = [], [], time.perf_counter()
    for piece in animate(model, clip.scene, clip.motion, name=clip.name, **options):
        times.append((time.perf_counter() - began, len(piece.V)))
        pieces.append(piece.V)
        began = time.perf_counter()
    whole = [1e3 * t / k for t, k in times[2:] if k == times[0][1]]
    return rmse(np.concatenate(pieces), clip.V), whole


def through_codes(model: Model, clip: Clip) -> np.ndarray:
    """Return the truth encoded and decoded, world."""
    return reconstructed(model, clip.scene, clip.motion, clip.V, clip.name)


def skinned(model: Model, clip: Clip) -> float:
    """Return the RMSE (cm) of the template carried by its seeds."""
    template, seeds = template_for(model, clip.scene, clip.name)
    inputs = motion_input(clip.motion, clip.scene, seeds, model.config.body.motion_joints)
    pose = make_skinned_template(template.T, seeds, model.config.body.tau)
    truth = to_root(clip.V.astype(np.float64), inputs.root, inputs.yaw)
    return rmse(np.asarray(pose(inputs.R_seed, inputs.t_seed)), truth)


def main() -> None:
    """Measure, print a Markdown table, write JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model")
    parser.add_argument("clips", type=Path)
    parser.add_argument("--also", action="append", default=[], metavar="NAME=RUN")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    model = trained_model(options.model)
    clips = [Clip(path) for path in sorted(options.clips.glob("*.h5"))]
    variants: dict[str, tuple[Model, dict]] = {
        "whole model": (model, {}),
        "untangled": (model._replace(config=untangled(model.config)), {}),
        **({"no column RNN": (without_column_rnn(model), {})} if "column_rnn" in model.params else {}),
        "no collision": (model, {"collision": False}),
        "no collision, no lengths": (without_lengths(model), {"collision": False}),
        "no collision, no detail": (model, {"collision": False, "detail": False}),
        "networks without detail": (without_lengths(model), {"collision": False, "detail": False}),
    }
    for pair in options.also:
        name, _, run = pair.partition("=")
        variants[name] = (trained_model(run), {"collision": False, "detail": False})
    rows: dict[str, dict] = {}
    for name, (chosen, settings) in variants.items():
        results = [rolled_out(chosen, clip, **settings) for clip in clips]
        times = [ms for _, later in results for ms in later]
        if not times:
            raise SystemExit(
                f"skirt: {name} has no clip of three chunks of {chosen.config.rollout.chunk} frames to time; "
                "give longer clips or a model of a smaller `rollout.chunk`."
            )
        rows[name] = {"rmse_cm": [r for r, _ in results], "ms_per_frame": float(np.median(times))}
        print(name, rows[name], flush=True)
    rows["auto-encoder of the truth"] = {
        "rmse_cm": [rmse(through_codes(model, clip), clip.V) for clip in clips]
    }
    rows["skinned template"] = {"rmse_cm": [skinned(model, clip) for clip in clips]}
    names = [clip.name for clip in clips]
    where = machine()
    print(f"\n{where['date']}, {where['processor']}, {where['cores']} cores, jax {where['jax']}\n")
    print(f"| RMSE cm | {' | '.join(names)} | mean | ms/frame |\n|{'---|' * (len(names) + 3)}")
    for name, row in rows.items():
        values = " | ".join(f"{x:.2f}" for x in row["rmse_cm"])
        speed = f"{row['ms_per_frame']:.1f}" if "ms_per_frame" in row else "–"
        print(f"| {name} | {values} | {np.mean(row['rmse_cm']):.2f} | {speed} |")
    if options.json:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        figures = {"machine": where, "clips": names, "rows": rows}
        options.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
