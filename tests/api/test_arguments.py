"""Arguments of a wrong kind are refused by name and value, whatever the function; `~` is the home folder."""

from pathlib import Path

import numpy as np
import pytest

import garment_jax as gj
from garment_jax.api.arguments import a_flag, an_integer, optional, shown, takes
from tests.animation.tiny_model import SCENE
from tests.api.tiny import SAMPLE, loaded
from tests.reference.files import write_bvh
from tests.reference.scene import write_clip

ARRAY = np.zeros(3)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory):
    return loaded(tmp_path_factory.mktemp("models") / "tiny")


WRONG = [
    (gj.load, (None,), {}, "model=None is no path; name a file or a folder"),
    (gj.load, ("",), {}, "model='' is no path"),
    (gj.load, ("skirt",), {"clip": ARRAY}, "clip=<ndarray> is no path"),
    (gj.load, ("skirt",), {"detail": "no"}, "detail='no' is neither True nor False"),
    (gj.animate, (None,), {}, r'model=None is no loaded model; give what gj\.load\("skirt"\) returns'),
    (gj.animate, ("skirt",), {}, r"model='skirt' is no loaded model; give what gj\.load\('skirt'\) returns"),
    (gj.animate, ("MODEL", ARRAY), {}, r"motion=<ndarray> is no motion; give a file, \(rotations, root\)"),
    (gj.animate, ("MODEL", "MODEL"), {}, "motion=<LoadedModel> is no motion"),
    (gj.animate, ("MODEL",), {"out": 5}, "out=5 is no path"),
    (gj.animate, ("MODEL",), {"preroll": 1.5}, r"preroll=1\.5 is no whole number"),
    (gj.animate, ("MODEL",), {"preroll": "x"}, "preroll='x' is no whole number"),
    (gj.animate, ("MODEL",), {"preroll": True}, "preroll=True is no whole number"),
    (gj.motion, ("skirt", "walk.bvh"), {}, "model='skirt' is no loaded model"),
    (gj.motion, ("MODEL", None), {}, "file=None is no path"),
    (gj.motion, ("MODEL", "walk.bvh"), {"joints": {}}, "joints={} is no path"),
    (gj.motion, ("MODEL", "walk.bvh"), {"source_fps": "60"}, "source_fps='60' is no finite number"),
    (gj.motion, ("MODEL", "walk.bvh"), {"source_fps": np.nan}, "source_fps=nan is no finite number"),
    (gj.motion, ("MODEL", "walk.bvh"), {"skip": 1.5}, r"skip=1\.5 is no whole number"),
    (gj.motion, ("MODEL", "walk.bvh"), {"unit": 1}, "unit=1 is no text"),
    (gj.motion, ("MODEL", "walk.bvh"), {"up": "w"}, r"walk\.bvh: the up axis 'w' is unknown; give X, Y or Z"),
    (gj.init, ("skirt", None), {}, "model='skirt' is no loaded model"),
    (gj.evaluate, ("MODEL", "MODEL"), {}, "truth=<LoadedModel> is no path"),
    (gj.evaluate, (ARRAY, "t.h5"), {}, "predicted=<ndarray> is neither a LoadedModel nor a path"),
    (gj.evaluate, ("p.h5", "t.h5"), {"every": "2"}, "every='2' is no whole number"),
    (gj.evaluate, ("p.h5", "t.h5"), {"every": 1.5}, r"every=1\.5 is no whole number"),
    (gj.export, ("p.h5", "a.npz"), {"fps": "30"}, "fps='30' is no finite number"),
    (gj.export, ("p.h5", "a.npz"), {"stop": 2.5}, r"stop=2\.5 is no whole number"),
    (gj.export, ("p.h5", None), {}, "out=None is no path"),
    (gj.train, (None,), {}, "config=None is neither a Config nor a path"),
    (gj.train, ("a.toml",), {"settings": [1]}, r"settings=\[1\] holds no settings by name; give a dict"),
    (gj.train, ("a.toml",), {"settings": {1: 2}}, "settings={1: 2} holds no settings by name"),
    (gj.simulate, (None, None, "made"), {}, "garment=None is neither a LoadedModel nor a path"),
    (gj.simulate, ("skirt", None, None), {}, "out=None is no path"),
    (gj.simulate, ("skirt", [5], "made"), {}, "motions=5 is no path"),
    (gj.simulate, ("skirt", None, "made"), {"test": 5}, r"test=5 is no list of names; give one"),
    (gj.simulate, ("skirt", None, "made"), {"say": None}, "say=None cannot be called"),
]


@pytest.mark.parametrize(("function", "given", "options", "sentence"), WRONG)
def test_a_wrong_kind_is_refused_with_its_name(
    model, tmp_path: Path, monkeypatch, function, given, options, sentence
):
    monkeypatch.chdir(tmp_path)
    walk = write_bvh(Path("walk.bvh"), SCENE.body, SAMPLE.motion)
    with pytest.raises(ValueError, match=sentence):
        function(*(model if isinstance(x, str) and x == "MODEL" else x for x in given), **options)
    assert list(tmp_path.iterdir()) == [tmp_path / walk]


def test_a_tilde_is_the_home_folder(model, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("USERPROFILE", str(tmp_path / "home"))
    write_clip(tmp_path / "home" / "a.h5", scene=SCENE, motion=SAMPLE.motion)
    out = tmp_path / "home" / "made"
    assert gj.export("~/a.h5", Path("~/made/a.npz"), unit="cm") == [out / "a.npz"]
    assert gj.animate(model, "~/a.h5", "~/made/", collision=False) == [out / "a.html"]
    assert [path.name for path in tmp_path.iterdir()] == ["home"]


def test_arguments_keep_their_places():
    @takes(a=an_integer, b=optional(an_integer), c=a_flag)
    def function(a, b=None, *, c=True, **more):
        return a, b, c, more

    assert function(np.int64(1), None, c=1, d="x") == (1, None, True, {"d": "x"})
    assert function(b=2, a=1) == (1, 2, True, {})
    with pytest.raises(TypeError, match="takes from 1 to 2 positional"):
        function(1, 2, 3)
    assert shown(SAMPLE.motion) == "<Motion>"
    assert len(shown("x" * 10_000)) < 110
