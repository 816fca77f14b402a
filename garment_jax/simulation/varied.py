"""More clips out of those that are there: `garment-jax simulate varied`."""

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from garment_jax.body.crossed_motion import cross_motions
from garment_jax.body.vary import Variation, cut, vary_motion
from garment_jax.io.content_hash import scene_hash, stored_attribute
from garment_jax.io.sequence import open_sequence
from garment_jax.io.validation import check_motion, check_scene
from garment_jax.simulation.clips import Job
from garment_jax.simulation.command import check_collider, check_same_cloth
from garment_jax.simulation.settings import ClothSettings
from garment_jax.structs import Motion, Scene

_CROSS = 77  # keeps the random numbers of crossed motions apart from those of variations


def varied_jobs(
    paths: Sequence[Path],
    *,
    copies: int,
    seed: int,
    turn: float = Variation().turn[1],
    spins: float = Variation().spins[1],
    kicks: float = Variation().kicks[1],
    longest: int | None = None,
    crosses: int = 0,
    settings: ClothSettings | None = None,
) -> tuple[Scene, list[Job]]:
    """Return the scene of simulated clips and motions made of theirs, to train on.

    `copies` variations of each clip (`vary_motion`), then `crosses` motions out of three clips each
    (`cross_motions`). `turn`: degrees per second that the body turns besides, at most; `spins`: quick turns
    in ten seconds on average, at most; `kicks`: raised legs, likewise; `longest`: frames of a motion, which
    is cut out anywhere. Give training clips only: what is made of a test clip is no longer unseen. In
    folders, clips that were made so before are passed over. Raises `FileNotFoundError` where there are
    none, `ValueError` for clips of different scenes, in another unit or with a broken motion, for those
    simulated here with other `settings`, and for fewer than three clips to cross.
    """
    if not copies and not crosses:
        raise ValueError("--copies 0 and --crosses 0 make no clips; give one of them.")
    files = [file for path in paths for file in (_recorded(path) if path.is_dir() else [path])]
    if not files:
        raise FileNotFoundError(f"{', '.join(map(str, paths))} holds no clips (*.h5); name one that does.")
    if crosses and len(files) < 3:
        raise ValueError(
            f"--crosses {crosses} needs three clips at least and {len(files)} are there; name more."
        )
    scene, motions = _read(files, settings)
    variation = Variation(turn=(-turn, turn), spins=(0.0, spins), kicks=(0.0, kicks))
    jobs = []
    for name, motion in motions:
        for copy in range(1, copies + 1):
            rng = np.random.default_rng([seed, copy, zlib.crc32(name.encode())])
            varied = vary_motion(motion, scene.body, rng, variation=variation)
            jobs.append(Job(f"{name}_v{copy}", "train", cut(varied, longest, rng), made_from=name))
    for k in range(crosses):
        rng = np.random.default_rng([seed, _CROSS, k])
        drawn = [motions[i] for i in rng.choice(len(motions), 3, replace=False)]
        crossed = _crossed([motion for _, motion in drawn], scene, rng, variation, longest)
        names = ", ".join(name for name, _ in drawn)
        jobs.append(Job(f"cross_{seed}_{k:03d}", "train", crossed, made_from=names))
    return scene, jobs


def _recorded(folder: Path) -> list[Path]:
    """Return a folder's clips that are no variations: else a call that goes on would vary its own."""
    return [path for path in sorted(folder.glob("*.h5")) if stored_attribute(path, "made_from") is None]


def _read(files: Sequence[Path], settings: ClothSettings | None) -> tuple[Scene, list[tuple[str, Motion]]]:
    """Return the scene that all clips share and their names and motions, checked."""
    scene, motions = None, []
    for file in files:
        with open_sequence(file) as clip:
            check_scene(clip.scene, str(file))
            check_motion(clip.motion, str(file))
            if clip.scene.collider is not None:
                check_collider(clip.scene.collider, file)
            scene = scene or clip.scene
            if scene_hash(clip.scene) != scene_hash(scene):
                raise ValueError(f"{file} has another garment or body than {files[0]}; vary them separately.")
            if settings is not None:
                check_same_cloth(clip, settings)
            motions.append((clip.name, clip.motion))
    assert scene is not None
    return scene, motions


def _crossed(
    motions: Sequence[Motion],
    scene: Scene,
    rng: np.random.Generator,
    variation: Variation,
    longest: int | None,
) -> Motion:
    """Return a motion out of variations of three."""
    variation = variation._replace(begin=(0.0, 0.0))
    first, second, third = (
        cut(vary_motion(motion, scene.body, rng, variation=variation), longest, rng) for motion in motions
    )
    return cross_motions(first, second, third, scene.body)
