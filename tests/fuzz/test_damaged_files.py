"""A few damaged files of every kind: no traceback, crash, hang or noise, and little memory."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.damaged_files import Trial, judge
from tests.fuzz.kinds import KINDS
from tests.fuzz.mutations import mutate

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="forks and measures as Linux does")
ROOT = Path(__file__).parents[2]


def test_damaged_files_of_every_kind_end_in_one_sentence():
    """In a process of its own, for it forks: this one has jax's threads."""
    # the long form has what jax or USD takes seconds for
    kinds = [kind for kind in KINDS if "usd" not in kind and (not KINDS[kind].needs or kind in QUICK)]
    command = [sys.executable, "-m", "tests.fuzz.damaged_files", "--files", "2", "--kinds", *kinds]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    bad = [line for line in done.stdout.splitlines() if line.split(":")[0] in WRONG]
    assert bad == []
    assert f"'files': {2 * len(kinds)}" in done.stdout.splitlines()[-1]


QUICK = ("model's config.toml", "model's model.json", "checkpoint's metadata", "run's own config")
WRONG = ("traceback", "crash", "hang", "noise", "memory")


@pytest.mark.parametrize(
    ("trial", "found"),
    [
        (Trial(0, 0, "", "fine"), set()),
        (Trial(2, 0, "error: clip.h5 is damaged.\n", ""), set()),
        (Trial(2, 0, "error: cannot reshape\n", ""), {"nameless"}),
        (Trial(2, 0, "error: clip.h5 is damaged: KeyError 'x'; copy it.\n", ""), {"net"}),
        (Trial(2, 0, "RuntimeWarning: overflow\nerror: clip.h5 is bad.\n", ""), {"noise"}),
        (Trial(70, 0, "Traceback (most recent call last):\nKeyError\n", ""), {"traceback"}),
        (Trial(-11, 0, "", ""), {"crash"}),
        (Trial(-14, 0, "", ""), {"hang"}),
        (Trial(2, 2**30, "error: clip.h5 is large.\n", ""), {"memory"}),
    ],
)
def test_what_is_wrong_with_a_trial(trial: Trial, found: set[str]):
    assert judge(trial, "x/clip.h5") == found


def test_the_same_seed_damages_the_same_way():
    import numpy as np

    data = bytes(range(256)) * 20
    first, again, other = (mutate(data, ".pc2", np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert first == again != other
    assert first != data
    assert all(kind.commands for kind in KINDS.values())
