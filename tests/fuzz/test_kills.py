"""A minute of kills and pairs from a fixed seed; the long form is a script (`tests/fuzz/kills.py`)."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="commands run in forks")
def test_killed_commands_go_on_to_the_same_files_and_leave_nothing() -> None:
    command = [sys.executable, "-m", "tests.fuzz.kills", "--seconds", "20"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " kills, 0 faults" in done.stdout
