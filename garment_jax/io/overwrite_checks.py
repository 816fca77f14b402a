"""Which names a sequence file may be written to, and what it may replace: no work of other commands."""

import os
from collections.abc import Iterable
from pathlib import Path

from garment_jax.io.content_hash import stored_attribute

LONGEST_NAME = 255  # bytes that file systems take
RESTARTED = "restarted_at_frame"  # attribute of what `floor` wrote
COLLIDED = "collision_eps_m"  # attribute of what `collide` wrote, whatever the kind of what it read


def check_name(path: Path) -> None:
    """Raise `ValueError` for a path without a file's name, such as `.`, or with one that is too long."""
    if path.name in ("", ".."):
        raise ValueError(f"{path} is a folder; name a sequence file (.h5).")
    for part in path.parts:
        size = len(os.fsencode(part))
        if size > LONGEST_NAME:
            raise ValueError(
                f"{part[:24]}… is a name of {size} bytes, more than {LONGEST_NAME}; give a shorter one."
            )


def check_prediction_out(out: Path) -> None:
    """Check where a prediction, or a sequence out of the body, is to be written.

    Raises `ValueError` for a name that no sequence file can have, and where there is what was neither
    predicted nor written by `collide`: it may be the garment's source, or a simulation.
    """
    check_sequence_name(out)
    if not os.path.exists(out):
        return
    if stored_attribute(out, "kind") != "predicted" and stored_attribute(out, COLLIDED) is None:
        raise ValueError(
            f"--out {out} is there and neither infer.py nor collide wrote it; name another --out, or move it "
            "away."
        )


def check_animation_out(out: Path, motion: Path) -> None:
    """Raise `ValueError` for an `out` that is the animation's own `motion`, or as `check_prediction_out`."""
    if out.resolve() == motion.resolve():
        raise ValueError(f"{out} holds the motion itself; write the animation to another file.")
    check_prediction_out(out)


def check_floor_out(out: Path) -> None:
    """Raise `ValueError` where a second simulation would replace what `floor` did not write."""
    check_sequence_name(out)
    if not os.path.exists(out):
        return
    # collide keeps the attributes of what it reads
    if stored_attribute(out, RESTARTED) is None or stored_attribute(out, COLLIDED) is not None:
        raise not_own(out, "floor")


def check_own(out: Path, marks: Iterable[bytes], command: str) -> None:
    """Raise `ValueError` where `out` is a file without any of `marks` in its first 64 kB.

    So what `command` writes replaces its own files alone; for formats whose files tell who wrote them.
    """
    if not out.is_file():
        return
    with open(out, "rb") as file:
        beginning = file.read(65_536)
    if not any(mark in beginning for mark in marks):
        raise not_own(out, command)


def not_own(out: Path, command: str) -> ValueError:
    """Return the refusal to replace `out`, which `command` did not write."""
    return ValueError(f"{out} is there and {command} did not write it; name another --out, or move it away.")


def check_sequence_name(out: Path) -> None:
    """Raise `ValueError` for an `--out` that no sequence file can have."""
    check_name(out)
    if os.path.isdir(out):  # unlike Path's own, this takes a path too long for one that is not there
        raise ValueError(f"--out {out} is a folder; name a sequence file (.h5).")
    if out.suffix != ".h5":
        raise ValueError(f"--out {out} does not end in .h5; name a sequence file, such as {out.name}.h5.")
