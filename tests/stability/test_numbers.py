from types import SimpleNamespace

import numpy as np

from garment_jax.stability import numbers
from tests.stability.small import reds, small_subject

SUBJECT = small_subject()
MOTION = SUBJECT.motions[0][1]


def test_every_case_is_green():
    assert reds(numbers.numbers_cases(SUBJECT).cases) == []


def test_features_that_know_where_they_stand_are_red(monkeypatch):
    monkeypatch.setattr(numbers, "motion_features", lambda motion, body, names: motion.root)
    assert any(
        "motion features change by" in line for line in reds(list(numbers._far(SUBJECT, MOTION, None)))
    )


def test_a_search_that_loses_its_digits_far_away_is_red(monkeypatch):
    contact = numbers.make_contact(SUBJECT.scene)

    def naive(V, C, surface):
        square = (V**2).sum(1)[:, None] + (C**2).sum(1)[None] - 2 * V @ C.T
        return SimpleNamespace(ds=np.sqrt(np.maximum(square.min(axis=1), 0)))

    monkeypatch.setattr(numbers, "closest_points", naive)
    assert any(
        "signed distance differs" in line for line in reds(list(numbers._far(SUBJECT, MOTION, contact)))
    )


def test_another_unit_that_is_accepted_is_red(monkeypatch):
    monkeypatch.setattr(numbers, "check_scene", lambda scene, name: None)
    assert len(reds(numbers._other_unit(SUBJECT, MOTION))) == 2


def test_a_division_by_a_denormal_is_red(monkeypatch):
    monkeypatch.setattr(numbers, "vertex_normals", lambda V, faces: V / (V**2).sum())
    (line,) = reds(list(numbers._denormal(SUBJECT)))
    assert line.startswith("denormal coordinates: normals")


def test_a_nan_that_is_let_in_is_red(monkeypatch):
    def other_row(path):
        raise ValueError("`root` is not finite in row 3")

    monkeypatch.setattr(numbers, "open_sequence", other_row)
    files = numbers._files(SUBJECT, MOTION)
    assert [next(files).verdict for _ in range(2)] == ["red", "red"]
    files.close()


def test_a_constant_feature_that_drowns_the_others_is_red(monkeypatch):
    monkeypatch.setattr(numbers, "normalise_motion", lambda M, template: 1e3 * M)
    assert any("a constant feature that moves" in line for line in reds(list(numbers._constant(SUBJECT))))


def test_a_root_without_care_at_zero_is_red(monkeypatch):
    monkeypatch.setattr(numbers, "size_of", lambda E, norm: ((E**2).sum()) ** 0.5)
    assert len(reds(list(numbers._at_zero(None)))) == 2
