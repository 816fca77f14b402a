"""Finding Blender and running a packaged script in it, as a program of its own.

Blender is a `blender` executable or a Python into which its module `bpy` was installed. Both bring libraries
that must not share a process with this package's.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

VARIABLE = "GARMENT_JAX_BLENDER"
_REMEDY = (
    "install Blender (blender.org), or its module with `pip install bpy` into a Python of its own, and name "
    f"the program with --blender or the variable {VARIABLE}"
)


def find_blender(given: str | Path | None = None) -> Path:
    """Return the Blender to use: `given`, GARMENT_JAX_BLENDER, `blender` on the PATH, or this Python.

    Each is a `blender` executable or a Python that has `bpy`. Raises `FileNotFoundError` with the remedy.
    """
    named = given or os.environ.get(VARIABLE)
    found = shutil.which(str(named or "blender"))
    if found:
        return Path(found)
    if named:
        source = "" if given else f"{VARIABLE}="
        raise FileNotFoundError(f"{source}{named} is no program; {_REMEDY}.")
    if importlib.util.find_spec("bpy"):
        return Path(sys.executable)
    raise FileNotFoundError(f"this needs Blender, which is not here; {_REMEDY}.")


def run_blender(
    script: str | Path,
    arguments: list[str],
    *,
    blender: str | Path | None = None,
    seconds: float | None = None,
) -> str:
    """Run a Python `script` in Blender and return what it printed.

    The script finds `arguments` after "--" in `sys.argv`. It says what is wrong by `sys.exit("sentence")`,
    which arrives as `ValueError`. Raises `FileNotFoundError` without Blender, `OSError` where Blender itself
    fails, `TimeoutError` where it took more than `seconds` and was ended. Ctrl-C ends Blender too.
    """
    program = find_blender(blender)
    if "python" in program.name.lower():
        # -I: the script's own folder must not hide Blender's modules
        command = [str(program), "-I", str(script), "--", *arguments]
    else:
        options = ["--background", "--factory-startup", "--python-exit-code", "1", "--python"]
        command = [str(program), *options, str(script), "--", *arguments]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False, timeout=seconds
        )
    except subprocess.TimeoutExpired as error:
        raise TimeoutError(f"{program} took more than {seconds:g} s and was ended.") from error
    except OSError as error:
        raise OSError(f"{program} could not be started ({error.strerror}); {_REMEDY}.") from error
    if done.returncode == 0:
        return done.stdout
    said = [line for line in done.stderr.splitlines() if line.strip()] or ["nothing said"]
    for line in reversed(said):
        if line.startswith("refused: "):
            raise ValueError(line.removeprefix("refused: "))
    if any("No module named 'bpy'" in line for line in said):
        raise FileNotFoundError(f"{program} has no module bpy; {_REMEDY}.")
    raise OSError(f"{program} failed (exit code {done.returncode}): {said[-1]}")
