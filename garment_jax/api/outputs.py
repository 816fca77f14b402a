"""What an animation is written as, by the name of the output: which file, and whether it may be written."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from garment_jax.exporters.cache_files import cache_files
from garment_jax.storage.overwriting import check_free
from garment_jax.storage.scratch import scratch

ENDINGS = {  # of each format; the first is what a name gets that is made here
    "html": (".html", ".htm"),
    "glb": (".glb",),
    "usd": (".usdc", ".usd", ".usda", ".usdz"),
    "abc": (".abc",),
    "pc2": (".pc2",),
    "mdd": (".mdd",),
    "obj": (".obj",),  # a folder, one file a frame
    "npz": (".npz",),
    "h5": (".h5",),
    "mp4": (".mp4",),
    "webp": (".webp",),
    "gif": (".gif",),
    "png": (".png",),
}


class Output(NamedTuple):
    """One motion's animation."""

    motion: Path | None  # None: the model's own sample
    path: Path
    format: str  # one of ENDINGS


def plan_outputs(
    motions: Sequence[Path | None],
    out: str | None,
    format: str | None,
    *,
    name: str,
    force: bool,
    going_on: Callable[[Output], bool] = lambda output: False,
) -> list[Output]:
    """Return where each motion's animation goes, `name` being the sample's.

    `out` is a file for one motion, by whose ending the format is known, or a folder. Without it files go
    into the current folder, named as their motions. Raises `ValueError` for an ending that is none, two
    motions of one name, what would be overwritten without `force` unless `going_on` says that it is of the
    same command, and a motion that would be at all.
    """
    stems = [name if motion is None else motion.stem for motion in motions]
    given = format_of(out) if out is not None else None
    if given is not None and out is not None and (len(motions) == 1 or format is None):
        if len(motions) > 1:
            raise ValueError(
                f"--out {out} is one file and there are {len(motions)} motions; name a folder, and --format "
                f"{given}."
            )
        if format not in (None, given):
            raise ValueError(f"--out {out} ends as {given} does, not {format}; leave --format {format} out.")
        outputs = [Output(motions[0], Path(out), given)]
    else:
        if out is not None and not out.endswith(("/", "\\")) and not Path(out).is_dir() and Path(out).suffix:
            if Path(out).suffix.lower() == ".fbx":
                raise ValueError(f"--out {out}: FBX is not written; end it in .glb, .usdc or .abc.")
            endings = ", ".join(known[0] for known in ENDINGS.values())
            raise ValueError(f"--out {out}: its ending names no format; end it in {endings}.")
        chosen, folder = format or "html", Path(out or ".")
        outputs = [
            Output(motion, folder / f"{stem}{ENDINGS[chosen][0]}", chosen)
            for motion, stem in zip(motions, stems, strict=True)
        ]
    _check(outputs, force, going_on)
    return outputs


def format_of(out: str) -> str | None:
    """Return the format that a name's ending says; None for a folder's."""
    suffix = Path(out).suffix.lower()
    found = next((name for name, endings in ENDINGS.items() if suffix in endings), None)
    return None if found != "obj" and (out.endswith(("/", "\\")) or Path(out).is_dir()) else found


def _check(outputs: Sequence[Output], force: bool, going_on: Callable[[Output], bool]) -> None:
    seen: dict[Path, Output] = {}
    for output in outputs:
        path = output.path.resolve()
        if path in seen:
            raise ValueError(
                f"{seen[path].motion} and {output.motion} would both be {output.path}; rename one of them."
            )
        seen[path] = output
        for motion in (other.motion for other in outputs):
            if motion is not None and motion.resolve() == path:
                raise ValueError(f"{output.path} holds the motion itself; write the animation elsewhere.")
        replacing = going_on(output) or force
        for made in companions(output):
            check_free(made, replacing, frames=True)


def companions(output: Output) -> list[Path]:
    """Return the files that an output is known to have."""
    return cache_files(output.path, body=True) if output.format in ("pc2", "mdd") else [output.path]


def move_into_place(made: Sequence[Path], folder: Path, *, force: bool) -> list[Path]:
    """Move whole files, or folders, into `folder` and return their new paths.

    Raises `ValueError` before anything is moved where one may not be replaced.
    """
    targets = [folder / path.name for path in made]
    for target in targets:
        check_free(target, force, frames=True)
    for path, target in zip(made, targets, strict=True):
        with scratch(folder) as aside:
            if target.is_dir():
                target.rename(aside / ".replaced")  # no folder takes the place of one that holds something
            path.replace(target)
    return targets
