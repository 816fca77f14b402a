"""The length tau of the softmax skinning weights against the strain of the unposed garment.

python experiments/tau.py data/skirt/train --clips 3 --every 40
"""

import argparse
from pathlib import Path

import jax
import numpy as np

from garment_jax.body.root_frame import to_root
from garment_jax.body.seeds import make_seeds
from garment_jax.config import BodyConfig
from garment_jax.dataset.motion_input import motion_input
from garment_jax.geometry.skinning import unskin_fixed_point
from garment_jax.geometry.topology import unique_edges
from garment_jax.io.sequence import open_sequence

TAUS = (0.005, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3, 0.5)


def main() -> None:
    """Print one row for every tau."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--clips", type=int, default=3)
    parser.add_argument("--every", type=int, default=40)
    parser.add_argument("--seeds", type=int, default=64)
    options = parser.parse_args()
    joints = BodyConfig().motion_joints
    V, R, t = [], [], []
    paths = sorted(options.folder.glob("*.h5"))
    for path in paths[:: max(len(paths) // options.clips, 1)][: options.clips]:
        with open_sequence(path) as sequence:
            scene = sequence.scene
            seeds = make_seeds(scene, options.seeds)
            inputs = motion_input(sequence.motion, scene, seeds, joints)
            frames = np.arange(options.every // 2, sequence.frames, options.every)
            world = np.concatenate([sequence.read(f, f + 1) for f in frames]).astype(np.float64)
        V.append(to_root(world, inputs.root[frames], inputs.yaw[frames]).astype(np.float32))
        R.append(inputs.R_seed[frames])
        t.append(inputs.t_seed[frames])
    T = (scene.garment.template - scene.body.joints[0]).astype(np.float32)
    edges = unique_edges(scene.garment.faces)
    rest = np.linalg.norm(T[edges[:, 0]] - T[edges[:, 1]], axis=1)

    @jax.jit
    def unpose(V, R, t, tau):
        one = lambda v, R, t: unskin_fixed_point(v, T, seeds.points, R, t, tau=tau, iterations=3)  # noqa: E731
        return jax.vmap(one)(V, R, t)

    names = ["τ m", "mean strain %", "strain p99 %", "from T, RMS cm", "over frames, RMS cm"]
    print("| " + " | ".join([*names, "largest condition"]) + " |\n|---|---|---|---|---|---|")
    for tau in TAUS:
        result = unpose(np.concatenate(V), np.concatenate(R), np.concatenate(t), tau)
        T_tilde = np.asarray(result.T_tilde)
        length = np.linalg.norm(T_tilde[:, edges[:, 0]] - T_tilde[:, edges[:, 1]], axis=-1)
        strain = 100 * np.abs(length / rest - 1)
        away = 100 * np.sqrt(np.square(T_tilde - T).sum(-1).mean())
        spread = 100 * np.sqrt(np.square(T_tilde - T_tilde.mean(0)).sum(-1).mean())
        print(
            f"| {tau:g} | {strain.mean():.1f} | {np.percentile(strain, 99):.0f} | {away:.1f} "
            f"| {spread:.1f} | {np.asarray(result.condition).max():.2f} |"
        )


if __name__ == "__main__":
    main()
