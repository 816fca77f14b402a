"""More clips out of those that are there: `garment-jax simulate --vary`."""

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from garment_jax.body.crossed_motion import cross_motions
from garment_jax.body.vary import Variation, cut, vary_motion
from garment_jax.data.content_hash import scene_hash
from garment_jax.data.sequence import open_sequence
from garment_jax.data.validation import check_motion, check_scene
from garment_jax.simulation.clips import Job
from garment_jax.simulation.command import check_collider
from garment_jax.structs import Motion, Scene

_CROSS = 77  # keeps the random numbers of crossed motions apart from those of variations


def varied_jobs(
    paths: Sequence[Path],
    *,
    copies: int,
    seed: int,
    turn: float = Variation().turn[1],
    longest: int | None = None,
    crosses: int = 0,
) -> tuple[Scene, list[Job]]:
    """Return the scene of simulated clips and motions made of theirs, to train on.

    `copies` variations of each clip (`vary_motion`), then `crosses` motions out of three clips each
    (`cross_motions`). `turn`: degrees per second that the body turns besides, at most; `longest`: frames
    of a motion, which is cut out anywhere. Give training clips only: what is made of a test clip is no
    longer unseen. Raises `FileNotFoundError` where there are none, `ValueError` for clips of different
    scenes, in another unit or with a broken motion, and for fewer than three clips to cross.
    """
    if not copies and not crosses:
        raise ValueError("--copies 0 and --crosses 0 make no clips; give one of them.")
    files = [file for path in paths for file in (sorted(path.glob("*.h5")) if path.is_dir() else [path])]
    if not files:
        raise FileNotFoundError(f"{', '.join(map(str, paths))} holds no clips (*.h5); name some with --vary.")
    if crosses and len(files) < 3:
        raise ValueError(
            f"--crosses {crosses} needs three clips at least and {len(files)} are there; name more."
        )
    scene, motions = _read(files)
    variation = Variation(turn=(-turn, turn))
    jobs = []
    for name, motion in motions.items():
        for copy in range(1, copies + 1):
            rng = np.random.default_rng([seed, copy, zlib.crc32(name.encode())])
            varied = vary_motion(motion, scene.body, rng, variation=variation)
            jobs.append(Job(f"{name}_v{copy}", "train", cut(varied, longest, rng)))
    for k in range(crosses):
        crossed = _crossed(
            list(motions.values()), scene, np.random.default_rng([seed, _CROSS, k]), turn, longest
        )
        jobs.append(Job(f"cross_{seed}_{k:03d}", "train", crossed))
    return scene, jobs


def _read(files: Sequence[Path]) -> tuple[Scene, dict[str, Motion]]:
    """Return the scene that all clips share and their motions by name, checked."""
    scene, motions = None, {}
    for file in files:
        with open_sequence(file) as clip:
            check_scene(clip.scene, str(file))
            check_motion(clip.motion, str(file))
            if clip.scene.collider is not None:
                check_collider(clip.scene.collider, file)
            scene = scene or clip.scene
            if scene_hash(clip.scene) != scene_hash(scene):
                raise ValueError(f"{file} has another garment or body than {files[0]}; vary them separately.")
            motions[clip.name] = clip.motion
    assert scene is not None
    return scene, motions


def _crossed(
    motions: Sequence[Motion], scene: Scene, rng: np.random.Generator, turn: float, longest: int | None
) -> Motion:
    """Return a motion out of variations of three clips drawn at random."""
    variation = Variation(begin=(0.0, 0.0), turn=(-turn, turn))
    drawn = rng.choice(len(motions), 3, replace=False)
    first, second, third = (
        cut(vary_motion(motions[k], scene.body, rng, variation=variation), longest, rng) for k in drawn
    )
    return cross_motions(first, second, third, scene.body)
