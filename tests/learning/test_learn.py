"""A whole tiny model, stopped in its midst and gone on with."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from garment_jax.cli.models import model_row
from garment_jax.learning import budget, learn, motions, networks
from garment_jax.learning.calibration import Calibration
from garment_jax.learning.learn import Given, Learnt, Wanted
from garment_jax.learning.motions import Recorded
from garment_jax.model.shipped import find_model
from garment_jax.model.store import load_model
from garment_jax.simulation import clips
from garment_jax.simulation.settings import ClothSettings
from tests.animation.tiny_model import CONFIG, SCENE
from tests.reference.scene import make_motion

STEPS = 4
CLOTH = ClothSettings(settle=3, blend=3, hold=1, substeps=5)


def tiny_config(scene, steps, *, seconds, seed):
    """The configuration of the tiny model with the steps that were decided."""
    generative, motion = (replace(getattr(CONFIG, n), steps=steps[n]) for n in ("generative", "motion"))
    return replace(
        CONFIG,
        data=replace(CONFIG.data, validation=()),
        generative=generative,
        motion=replace(motion, warm_up_steps=steps["warm_up"]),
        detail=replace(CONFIG.detail, steps=steps["detail"]),
        column_rnn=replace(
            CONFIG.column_rnn,
            steps=steps.get("column_rnn", 0),
            columns=6,
            rows=3,
            hidden=4,
            width=4,
            lanes=2,
            window=4,
        ),
    )


@pytest.fixture
def tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few frames, few steps, small networks."""
    for name, value in (
        ("FEWEST_FRAMES", 20),
        ("MOST_FRAMES", 24),
        ("FEWEST_KEPT_BACK", 9),
        ("SHORTEST_CLIP", 12),
    ):
        monkeypatch.setattr(budget, name, value)
    monkeypatch.setattr(budget, "MOST_KEPT_BACK", 9)
    monkeypatch.setattr(motions, "SHORTEST", 8)
    monkeypatch.setattr(budget, "STAGES", {k: (v[0], STEPS, STEPS) for k, v in budget.STAGES.items()})

    def calibrate(config, *_: object) -> Calibration:
        trained = (name for name in budget.STAGES if name != "column_rnn" or config.column_rnn.steps)
        return Calibration(dict.fromkeys(trained, 1.0), 5.0)

    monkeypatch.setattr(learn, "calibrate", calibrate)
    monkeypatch.setattr(learn, "config_for", tiny_config)


def test_what_the_screening_left_out_is_not_simulated_again(
    tiny: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = Recorded({n: make_motion(SCENE, 24, seed=k, legs=0.1) for k, n in enumerate("abc")}, ["b"])
    given, screened, simulated = Given(SCENE, None, CLOTH, source), [], []

    def second_fails(*_: object) -> list[str]:
        screened.append(1)
        return ["strain"] if len(screened) == 2 else []

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    simulate = clips.simulate_many
    monkeypatch.setattr(clips, "faults", second_fails)
    monkeypatch.setattr(
        clips, "simulate_many", lambda *a, **k: simulated.extend(a[1].values()) or simulate(*a, **k)
    )
    monkeypatch.setattr(learn, "train", stop)
    monkeypatch.setattr(learn, "FEWEST_CLIPS", 1)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            learn.learn(given, tmp_path / "model", tmp_path / "work", Wanted(2.0), say=lambda _: None)
        assert len(simulated) == len(screened) >= 3  # nothing anew the second time
    left_out = json.loads((tmp_path / "work" / "plan.json").read_text())["left_out"]
    assert left_out == [simulated[1].name]
    assert not (tmp_path / "work" / "clips" / "train" / f"{left_out[0]}.h5").exists()


@pytest.mark.slow
@pytest.mark.parametrize("brief", [False, True])
def test_a_stopped_call_goes_on_to_a_model_that_runs_alone(
    tiny: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, brief: bool
) -> None:
    monkeypatch.setattr(networks, "BRIEF", 1e9 if brief else 0.0)
    stages = [name for name in budget.STAGES if not (brief and name == "column_rnn")]
    out, work, said = tmp_path / "model", tmp_path / "model.work", []
    source = Recorded({n: make_motion(SCENE, 24, seed=k, legs=0.1) for k, n in enumerate("abc")}, ["b"])
    given = Given(SCENE, None, CLOTH, source)

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(learn, "train", stop)
        with pytest.raises(KeyboardInterrupt):
            learn.learn(given, out, work, Wanted(2.0), say=said.append)
    before = json.loads((work / "plan.json").read_text())
    assert before["steps"] == dict.fromkeys(stages, STEPS)
    assert sorted(path.stem for path in (work / "clips" / "test").iterdir()) == ["b"]
    assert not out.exists()

    learnt = learn.learn(given, out, work, Wanted(2.0), say=said.append)
    assert isinstance(learnt, Learnt)
    after = json.loads((work / "plan.json").read_text())
    assert {
        k: v for k, v in before.items() if k not in ("seconds", "trained", "done")
    }.items() <= after.items()
    assert after["done"]
    figures = json.loads((out / "figures.json").read_text())
    assert figures["clips"]["b"]["rmse_cm"] == pytest.approx(learnt.rmse_cm, abs=1e-4)
    assert model_row("model", out)[3] == f"{figures['ms_per_frame']:.1f}" != "0.0"
    assert ("column_rnn" in load_model(find_model(out)).params) is not brief
    assert ("column_rnn: left out, in so few minutes the latents alone err by less" in said) is brief
    assert {path.name for path in out.iterdir()} >= {
        "picture.png",
        "scene.h5",
        "parameters.npz",
        "model.json",
    }
    assert [page.name for page in learnt.pages] == ["b.html"]
    assert learnt.pages[0].is_file()
    assert (work / "pins.png").is_file()

    assert learn.learn(given, out, work, Wanted(2.0), say=said.append) is None
    assert "complete, nothing to do" in said[-1]
    with pytest.raises(ValueError, match=r"was begun with minutes 2.0, not 3.0; give the same again"):
        learn.learn(given, out, work, Wanted(3.0), say=said.append)
    with pytest.raises(ValueError, match="holds a model; --force replaces it, or name another --out"):
        learn.learn(given, out, tmp_path / "other", Wanted(2.0), say=said.append)
    assert not (tmp_path / "other").exists()
