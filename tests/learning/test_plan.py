"""The plan of a work folder: kept over calls, and refused for another command."""

import json
from pathlib import Path

import pytest

from garment_jax.learning.plan import PLAN, PlanFile

ASKED = {"minutes": 4.0, "motions": "abc"}


def test_what_was_decided_is_there_in_the_next_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10.0]
    monkeypatch.setattr("garment_jax.learning.plan.time.monotonic", lambda: now[0])
    file = PlanFile(tmp_path, ASKED)
    file.decide(frames=500, steps={"motion": 7})
    with pytest.raises(KeyboardInterrupt), file.timed("simulate"):  # noqa: PT012
        now[0] += 20.0
        raise KeyboardInterrupt
    again = PlanFile(tmp_path, ASKED)
    assert (again.plan.frames, again.plan.steps, again.plan.done) == (500, {"motion": 7}, False)
    with again.timed("simulate"):
        now[0] += 5.0
    assert json.loads((tmp_path / PLAN).read_text())["seconds"] == {"simulate": 25.0}


def test_the_folder_of_another_command_and_of_other_things_are_refused(tmp_path: Path) -> None:
    PlanFile(tmp_path, ASKED).decide()
    with pytest.raises(ValueError, match=r"was begun with minutes 4.0, not 5.0; give the same again"):
        PlanFile(tmp_path, {**ASKED, "minutes": 5.0})
    (tmp_path / PLAN).write_text("{")
    with pytest.raises(ValueError, match=r"plan.json is damaged .*; name another --work"):
        PlanFile(tmp_path, ASKED)
    (tmp_path / PLAN).rename(tmp_path / "letters.txt")
    with pytest.raises(ValueError, match=r"holds 'letters.txt' but no plan.json; name another --work"):
        PlanFile(tmp_path, ASKED)
