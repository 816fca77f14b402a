"""`garment-jax simulate` and `garment-jax floor`: which clips, with which settings."""

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from collections.abc import Sequence as List
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from garment_jax.evaluation.penetration import neighbour_faces
from garment_jax.importers.motions import SUFFIXES, read_motion
from garment_jax.io.hdf5 import dataset, has, open_hdf5, read_all
from garment_jax.io.layout import Field, check_fields
from garment_jax.io.npz import read_arrays
from garment_jax.io.sequence import Sequence
from garment_jax.io.validation import check_motion
from garment_jax.procedural.motions import MOTIONS, make_dance, make_motion
from garment_jax.simulation.clips import ENGINE, Job
from garment_jax.simulation.rest_shape import rest_shape
from garment_jax.simulation.settings import ClothSettings, parse_cloth
from garment_jax.structs import Collider, Garment, RiggedBody

EMBEDDED_CLIP = 112  # frames of an embedded clip, about
SHORTEST = 80  # frames that can be split into training and test
DANCE_SEED = 1_005  # far from the training motions' seeds; with seed 0 it turns and swings
# Many folds, or a free front, lie on each other: without self-collision they tangle for good.
EMBEDDED_CLOTH = {"circle_skirt": ["self_collision=on"], "cape": ["self_collision=on"]}
_LEAST = {
    "workers": 1,
    "at_once": 1,
    "copies": 0,
    "crosses": 0,
    "frames": 1,
    "seed": 0,
    "skip": 0,
    "source_fps": 1,
    "turn": 0,
    "spins": 0,
    "kicks": 0,
    "longest": 30,
}
_MOST = {"source_fps": 10_000, "turn": 3600, "spins": 100, "kicks": 100}


def cloth_settings(pairs: Iterable[str]) -> ClothSettings:
    """Return the settings with `KEY=VALUE` pairs put in; `ValueError` for an unknown key or a wrong value."""
    return parse_cloth(pairs, "--cloth")


def read_pattern(path: Path) -> np.ndarray:
    """Read a flat pattern `[u, 2]`, metres, a point a UV: `flat` of an .npz, `rest_uv_metres` of an .h5.

    Raises `FileNotFoundError`, `OSError` for a damaged file, `ValueError` for one that holds none, or
    anything but finite points of the plane.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} is not there; name the file of the flat pattern.")
    name = "flat" if path.suffix == ".npz" else "rest_uv_metres"
    pattern = read_arrays(path, (name,)).get(name) if name == "flat" else _read_hdf5(path, name)
    if pattern is None:
        raise ValueError(
            f"{path} holds no array 'flat' (.npz) or dataset 'rest_uv_metres' (.h5); store the points there."
        )
    check_fields((Field(name, "f8", ("u", 2)),), {name: pattern}, str(path))
    return pattern


def _read_hdf5(path: Path, name: str) -> np.ndarray | None:
    with open_hdf5(path) as file:
        if not has(file, name, str(path)):
            return None
        return read_all(dataset(file, name, str(path)), str(path))


def check_numbers(options: Mapping[str, Any]) -> None:
    """Raise `ValueError` for a number of `options`, by name, that is out of range; None was not given."""
    for name, least in _LEAST.items():
        value = options.get(name)
        if value is not None and not value >= least:  # NaN is no number either
            raise ValueError(f"--{name.replace('_', '-')} {value} is too small; give {least} or more.")
        if value is not None and value > (most := _MOST.get(name, math.inf)):
            raise ValueError(f"--{name.replace('_', '-')} {value} is too large; give {most} or less.")


def check_rest_shape(garment: Garment, flat: np.ndarray | None, path: Path) -> None:
    """Raise `ValueError`, with the name of the file to repair, for a rest shape that cannot be simulated."""
    with _naming(path):
        rest_shape(garment, flat)


def check_collider(collider: Collider, path: Path) -> None:
    """Raise `ValueError`, with the file's name, for a collider that is empty or not closed."""
    if not len(collider.faces):
        raise ValueError(f"{path}: the collider has 0 faces; give it those that the cloth touches.")
    with _naming(path):
        neighbour_faces(collider.faces)


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the file's name in front of a refusal that does not know it."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def check_same_cloth(clip: Sequence, settings: ClothSettings, *, free: Container[str] = ()) -> None:
    """Raise `ValueError` for a clip that `simulate` made with other settings: its cloth would be another.

    Those in `free` may differ.
    """
    said = clip.attributes.get("settings")
    if clip.attributes.get("engine") != ENGINE or said is None or str(said) == settings.describe():
        return
    # a setting that came later was at its default
    theirs = _described(ClothSettings().describe()) | _described(str(said))
    ours = _described(settings.describe())
    keys = [key for key in ours if key not in free]
    odd = [f"{key} {theirs[key]} there and {ours[key]} here" for key in keys if theirs[key] != ours[key]]
    if odd:
        raise ValueError(f"{clip.path} was simulated with other cloth ({odd[0]}); give its own with --cloth.")


def _described(settings: str) -> dict[str, str]:
    """Return the settings that `ClothSettings.describe` put into a line, by name."""
    return dict(part.split(" ", 1) for part in settings.split(", ") if " " in part)


def check_frames(frames: int) -> None:
    """Raise `ValueError` for too few frames of embedded motions."""
    if frames < SHORTEST:
        raise ValueError(
            f"--frames {frames} are too few to train and to test on; ask for {SHORTEST} or more."
        )


def embedded_jobs(body: RiggedBody, *, frames: int, fps: float, seed: int) -> list[Job]:
    """Return clips of the embedded motions, `frames` in all: one of each kind in turn, a dance to test on.

    The dance, a quarter of the frames, joins moves in an order and with gestures that no training clip
    has. Raises `ValueError` when there are too few frames to train and to test on.
    """
    check_frames(frames)
    dance = frames // 4
    clips = max(round((frames - dance) / EMBEDDED_CLIP), 1)
    jobs = []
    for k, part in enumerate(np.array_split(np.arange(frames - dance), clips)):
        kind, turn = MOTIONS[k % len(MOTIONS)], k // len(MOTIONS)
        motion = make_motion(kind, body, seconds=len(part) / fps, fps=fps, seed=seed + turn)
        jobs.append(Job(f"{kind}_{turn + 1:02d}", "train", motion))
    motion = make_dance(body, seconds=dance / fps, fps=fps, seed=seed + DANCE_SEED)
    return [*jobs, Job("dance", "test", motion)]


def motion_jobs(
    paths: List[Path],
    body: RiggedBody,
    *,
    fps: float,
    test: List[str] = (),
    joints: dict[str, str] | None = None,
    source_fps: float | None = None,
    skip: int = 0,
    rest_frame: int | None = None,
    floor: bool = True,
    unit: str | None = None,
    up: str | None = None,
    rest_up: str | None = None,
    body_file: Path | None = None,
    body_unit: str | None = None,
    origin: np.ndarray | None = None,
    animation: str | None = None,
    mesh: str | None = None,
    skeleton: str | None = None,
    say: Callable[[str], None] = print,
    left_out: list[str] | None = None,
) -> list[Job]:
    """Return a clip for every motion named, or found in a folder named; those in `test` are for testing.

    A motion of several that cannot be used gets a line, its name comes into `left_out`, and the others go on;
    a single one raises.

    The unit of `body_file` is that of a motion in the same file, whose own `unit` is not said. The other
    options as in `read_motion`.
    Raises `FileNotFoundError` where there is none, `ValueError` for a test clip that no file is named for and
    for a root that jumps, which nothing could be trained on.
    """
    files = [file for path in paths for file in (_motions_in(path) if path.is_dir() else [path])]
    if not files:
        raise FileNotFoundError(
            f"{', '.join(map(str, paths))} holds no motions ({', '.join(SUFFIXES)}); name some with --motion."
        )
    missing = sorted(set(test) - {file.stem for file in files})
    if missing:
        raise ValueError(f"--test {missing[0]}: there is no such motion; there are {_names(files)}.")
    jobs = []
    for file in files:
        same = body_file is not None and file.resolve() == body_file.resolve()
        try:
            motion = read_motion(
                file,
                body,
                fps=fps,
                source_fps=source_fps,
                joints=joints,
                skip=skip,
                rest_frame=rest_frame,
                floor=floor,
                unit=body_unit if unit is None and same else unit,
                up=up,
                rest_up=rest_up,
                origin=origin,
                animation=animation,
                mesh=mesh,
                skeleton=skeleton,
                say=say,
            )
            check_motion(motion, str(file))
        except (ValueError, OSError) as error:
            if left_out is None or len(files) == 1:
                raise
            left_out.append(file.stem)
            say(f"{file.stem}: left out: {error}")
            continue
        jobs.append(Job(file.stem, "test" if file.stem in test else "train", motion))
    return jobs


def _motions_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)


def _names(files: List[Path]) -> str:
    return ", ".join(file.stem for file in files)
