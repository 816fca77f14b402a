import json

import numpy as np
import pytest

from garment_jax.body.root_frame import yaw_matrix
from garment_jax.evaluation import command, sted
from garment_jax.evaluation.command import evaluate_files
from garment_jax.evaluation.hausdorff import hausdorff
from garment_jax.evaluation.rmse import rmse
from garment_jax.evaluation.summary import mean_metrics
from garment_jax.evaluation.table import COLUMNS, REST_OF_THE_BODY, SIDE_BY_SIDE, format_table
from garment_jax.io.sequence import SequenceWriter, open_sequence
from tests.reference.scene import make_motion, make_scene, make_vertices

FRAMES = 40


@pytest.fixture(scope="module")
def scene():
    return make_scene()


def _write(path, scene, motion, V, **options):
    with SequenceWriter(path, scene, motion, encoding="float32", **options) as writer:
        writer.append(V)
    return path


@pytest.fixture(scope="module")
def pair(scene, tmp_path_factory):
    """A prediction and its truth: the same motion, other folds."""
    folder = tmp_path_factory.mktemp("pair")
    motion = make_motion(scene, FRAMES)
    truth = _write(folder / "truth.h5", scene, motion, make_vertices(scene, motion, 0))
    pred = _write(folder / "pred.h5", scene, motion, make_vertices(scene, motion, 1))
    return pred, truth


@pytest.fixture(scope="module")
def result(pair):
    return evaluate_files(*pair, every=5)


def _vertices(path):
    with open_sequence(path) as clip:
        return clip.read(0, clip.frames).astype(np.float64) - clip.motion.root[:, None]


def test_equals_the_metrics_of_the_whole_clip(pair, result, scene):
    V, V_star = map(_vertices, pair)
    metrics, faces = result["metrics"], scene.garment.faces
    assert metrics["rmse_cm"] == pytest.approx(rmse(V, V_star))
    assert metrics["mean_distance_cm"] == pytest.approx(100 * np.linalg.norm(V - V_star, axis=-1).mean())
    assert metrics["hausdorff_cm"] == pytest.approx(hausdorff(V, V_star, faces, every=5))
    whole = sted.sted(V, V_star, faces)
    assert metrics["sted_spatial"] == pytest.approx(whole.spatial)
    assert metrics["sted_temporal"] == pytest.approx(whole.temporal)
    assert metrics["sted"] == pytest.approx(whole.combined)
    assert len(result["per_frame"]["rmse_cm"]) == FRAMES
    assert np.mean(result["per_frame"]["hem_height_cm"]) == pytest.approx(metrics["hem_height_cm"])
    assert result["per_sampled_frame"]["frame"] == list(range(0, FRAMES, 5))


@pytest.mark.parametrize("window", [1, 7, 39])
def test_windows_change_nothing(pair, result, window, monkeypatch):
    monkeypatch.setattr(command, "WINDOW", window)
    again = evaluate_files(*pair, every=5)
    for name, value in result["metrics"].items():
        assert again["metrics"][name] == pytest.approx(value, rel=1e-9), name


def test_a_rigid_motion_of_both_changes_no_metric(pair, result, scene, tmp_path):
    turn, shift = yaw_matrix(np.array(2.391)), np.array([40.0, 0.0, -25.0])
    moved = []
    for path in pair:
        with open_sequence(path) as clip:
            m = clip.motion
            V = clip.read(0, clip.frames) @ turn.T + shift
        motion = m._replace(
            rotations=(turn @ m.rotations).astype(np.float32),
            root=(m.root @ turn.T + shift).astype(np.float32),
        )
        moved.append(_write(tmp_path / path.name, scene, motion, V.astype(np.float32)))
    again = evaluate_files(*moved, every=5)["metrics"]
    for name, value in result["metrics"].items():
        if value is not None:
            assert again[name] == pytest.approx(value, rel=2e-3, abs=2e-3), name


def test_the_truth_against_itself_is_perfect(pair):
    metrics = evaluate_files(pair[1], pair[1], every=20)["metrics"]
    for name in ("rmse_cm", "hausdorff_cm", "sted", "hem_height_difference_cm"):
        assert metrics[name] == 0.0
    ratios = {k: v for k, v in metrics.items() if k.endswith("_ratio") and v is not None}
    assert set(ratios.values()) == {1.0}
    assert "laplacian_power_ratio" in ratios
    assert metrics["drift_ratio"] is None  # no error has no drift


def test_penetration_sees_a_garment_pushed_into_the_body(pair, scene, tmp_path):
    with open_sequence(pair[1]) as clip:
        motion, V = clip.motion, clip.read(0, clip.frames)
    axis = motion.root[:, None] * [1, 0, 1] + V * [0, 1, 0]
    thin = _write(tmp_path / "thin.h5", scene, motion, (axis + 0.3 * (V - axis)).astype(np.float32))
    metrics = evaluate_files(thin, pair[1], every=20)["metrics"]
    assert metrics["inside_percent"] > 10
    assert metrics["deepest_mm"] > 10
    assert 0 <= metrics["pinched_percent"] < 1  # this body's legs hardly cross
    apart = metrics["pinched_percent"] + metrics["unpinched_inside_percent"]
    assert apart == pytest.approx(metrics["inside_percent"])


def test_what_lies_where_the_legs_cross_is_reported_apart(pair, scene, tmp_path):
    with open_sequence(pair[1]) as clip:
        motion, V = clip.motion, clip.read(0, clip.frames)
    names = scene.body.joint_names
    rotations = motion.rotations.copy()
    for side, sign in (("Left", -1), ("Right", 1)):  # knees together and past each other
        turn, c, s = np.eye(3), np.cos(0.5), sign * np.sin(0.5)
        turn[:2, :2] = [[c, -s], [s, c]]
        for part in ("UpLeg", "Leg", "Foot", "ToeBase"):
            rotations[:, names.index(side + part)] = motion.rotations[:, 0] @ turn
    crossed = motion._replace(rotations=rotations.astype(np.float32))
    V[:, -1] = motion.root + (motion.rotations[:, 0] @ [0.0, -0.3, 0.0])
    path = _write(tmp_path / "crossed.h5", scene, crossed, V)
    metrics = evaluate_files(path, path, every=20)["metrics"]
    assert metrics["pinched_percent"] >= 100 / V.shape[1] - 1e-9
    assert metrics["truth_pinched_percent"] == metrics["pinched_percent"]
    assert metrics["unpinched_inside_percent"] < metrics["inside_percent"]


def test_without_collider_pins_or_arms_the_rest_is_measured(pair, scene, tmp_path):
    bare = scene._replace(collider=None, pins=None)
    paths = []
    for path in pair:
        with open_sequence(path) as clip:
            paths.append(_write(tmp_path / path.name, bare, clip.motion, clip.read(0, clip.frames)))
    metrics = evaluate_files(*paths, every=20)["metrics"]
    assert metrics["inside_percent"] is None
    assert metrics["hem_motion_std_ratio"] > 0
    assert "–" in format_table(evaluate_files(*paths, every=20))
    assert evaluate_files(*pair, every=20, arms=False)["metrics"]["arms_inside_percent"] is None


def test_result_is_plain_json_and_every_number_has_its_unit(result):
    json.dumps(result, allow_nan=False)
    plain = ("_per_s", "sted", "_ratio", "_edges", "sted_spatial", "sted_temporal")
    for name in result["metrics"]:
        assert name.endswith(("_cm", "_mm", "_percent", "_cm2", *plain)), name


def table_of(text: str) -> list[list[str]]:
    """Return the cells of a Markdown table, its rule left out."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len({len(line) for line in lines}) == 1, "columns line up"
    assert set(lines[1]) == set("|-:")
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[:1] + lines[2:]]


@pytest.mark.parametrize("clips", [1, 2, SIDE_BY_SIDE, SIDE_BY_SIDE + 1])
def test_table_has_every_metric_of_every_clip_and_the_mean(result, clips):
    text = format_table([result] * clips)
    cells = table_of(text) if clips > SIDE_BY_SIDE else list(zip(*table_of(text), strict=True))
    assert len(cells) == 1 + clips + (clips > 1)
    assert list(cells[0]) == ["clip", "frames", *(heading for heading, _, _ in COLUMNS)]
    assert cells[1][0] == result["clip"]
    assert all(line[2] == f"{result['metrics']['rmse_cm']:.2f}" for line in cells[1:])
    assert cells[-1][0] == (result["clip"] if clips == 1 else f"mean of {clips}")
    assert "c = 0.1" in text


def test_table_of_the_whole_body_has_the_arms_too(result):
    assert {name for _, name, _ in COLUMNS + REST_OF_THE_BODY} <= set(result["metrics"])
    lines, wider = (table_of(format_table(result, whole_body=on)) for on in (False, True))
    assert wider[: len(lines)] == lines
    assert [line[0] for line in wider[len(lines) :]] == [heading for heading, _, _ in REST_OF_THE_BODY]


def test_a_mean_of_nothing_and_no_frame_at_all_are_refused(result):
    assert mean_metrics([result, result])["rmse_cm"] == pytest.approx(result["metrics"]["rmse_cm"])
    with pytest.raises(ValueError, match="0 results"):
        mean_metrics([])
    with pytest.raises(ValueError, match="--every 0"):
        evaluate_files(result["prediction"], result["truth"], every=0)


def test_a_second_simulation_says_which_frames_are_determined(pair, result, scene, tmp_path):
    with open_sequence(pair[1]) as clip:
        motion, V = clip.motion, clip.read(0, clip.frames)
    V[25:, :, 1] -= 0.02  # from frame 25 on, 2 cm lower
    again = _write(tmp_path / "again.h5", scene, motion, V)
    found = evaluate_files(*pair, every=5, again=again)
    error, metrics = np.array(result["per_frame"]["rmse_cm"]), found["metrics"]
    assert metrics["determined_percent"] == pytest.approx(100 * 25 / FRAMES)
    assert metrics["determined_rmse_cm"] == pytest.approx(np.sqrt((error[:25] ** 2).mean()))
    assert metrics["parted_error_ratio"] == pytest.approx(np.sqrt((error[25:] ** 2).mean()) / 2, rel=1e-4)
    assert result["metrics"].items() <= metrics.items()
    assert table_of(format_table(found))[2][0] == "determined %"


def test_what_is_no_second_simulation_is_refused_with_how_to_make_one(pair, scene, tmp_path):
    with open_sequence(pair[1]) as clip:
        motion, V = clip.motion, clip.read(0, clip.frames)
    again, other = tmp_path / "again.h5", make_motion(scene, FRAMES, seed=5)
    for moves, vertices, about, said in (
        (other, V, {}, r"the motions of .*again.h5 and .*truth.h5 differ at frame"),
        (motion, V, {"kind": "predicted"}, r"--again .*again.h5 is predicted"),
        (motion, 100 * V, {}, r"--again .*again.h5 is [0-9]+ cm from .*truth.h5 in frame 0"),
    ):
        _write(again, scene, moves, vertices, attributes=about)
        with pytest.raises(ValueError, match=said + r".*a second time.*\(garment-jax floor"):
            evaluate_files(*pair, again=again)


def test_speed_is_that_of_the_vertices_past_the_root(pair, result):
    V = _vertices(pair[0])
    with open_sequence(pair[0]) as clip:
        each = 100 * clip.fps * np.linalg.norm(np.diff(V, axis=0), axis=-1)
    assert result["metrics"]["speed_mean_cm_per_s"] == pytest.approx(each.mean(), rel=1e-4)
    top = np.percentile(each, 99, axis=1).mean()
    assert result["metrics"]["speed_p99_cm_per_s"] == pytest.approx(top, rel=1e-4)


def test_progress_counts_measured_frames_and_windows_to_the_end(pair):
    seen = []
    evaluate_files(*pair, every=50, progress=lambda done, total: seen.append((done, total)))
    frames = seen[-1][1]
    windows = [*range(command.WINDOW, frames, command.WINDOW), frames]
    assert [done for done, _ in seen] == sorted([*range(1, frames + 1, 50), *windows])
