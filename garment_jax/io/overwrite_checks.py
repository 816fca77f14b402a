"""Which names sequence files may be written to, and how they tell which command wrote them."""

import os
from pathlib import Path

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


def check_sequence_name(out: Path) -> None:
    """Raise `ValueError` for an `--out` that no sequence file can have."""
    check_name(out)
    if os.path.isdir(out):  # unlike Path's own, this takes a path too long for one that is not there
        raise ValueError(f"--out {out} is a folder; name a sequence file (.h5).")
    if out.suffix != ".h5":
        raise ValueError(f"--out {out} does not end in .h5; name a sequence file, such as {out.name}.h5.")


def check_animation_out(out: Path, motion: Path) -> None:
    """Raise `ValueError` for an `out` that is the animation's own `motion`, or as `check_sequence_name`."""
    if out.resolve() == motion.resolve():
        raise ValueError(f"{out} holds the motion itself; write the animation to another file.")
    check_sequence_name(out)
