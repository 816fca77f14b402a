"""The page in a headless Chromium: what only a browser can tell."""

import io
import re

import numpy as np
import pytest
from PIL import Image

from garment_jax.evaluation.rmse import rmse, rmse_per_frame
from garment_jax.io.sequence import open_sequence
from garment_jax.viewer import command
from garment_jax.viewer.command import view_files
from tests.reference.scene import make_motion, make_scene, write_clip
from tests.viewer.browser import Browser, find_browser

BOX = """(({x, y, right, bottom}) => [x, y, right, bottom])(
  document.getElementById('%s').getBoundingClientRect())"""
MOVED = """new Promise(done => {
  const look = () => garmentViewer.player.frame > 1 ? done(true) : setTimeout(look, 30);
  look();
})"""
SCALE = """(() => {
  const input = document.getElementById('scale-top');
  input.value = %s;
  input.dispatchEvent(new Event('input'));
})()"""
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder, scene = tmp_path_factory.mktemp("browser"), make_scene(16, 32)
    motion = make_motion(scene, 20)
    clips = [
        write_clip(folder / f"{k}.h5", seed=i, scene=scene, motion=motion, attributes={"kind": k})
        for i, k in enumerate(("predicted", "simulated"))
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "CHUNK", 8)
        view_files(clips, folder / "p.html", penetration=True, title='<i>"two" & one')
    return folder / "p.html", clips


@pytest.fixture(scope="module")
def browser(page):
    executable = find_browser()
    if executable is None:
        pytest.skip("no Chromium found; install chromium to test the page")
    with Browser(executable) as opened:
        opened.open(page[0])
        yield opened


def picture(browser):
    with Image.open(io.BytesIO(browser.screenshot())) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def stage(browser):
    """The pixels of the stage alone."""
    box = browser.evaluate(BOX % "stage")
    x, y, right, bottom = map(int, box)
    return picture(browser)[y:bottom, x:right]


def test_it_opens_from_the_disk_without_complaint_or_request(browser, page):
    assert browser.requests() == [page[0].resolve().as_uri()]
    assert browser.complaints() == []
    assert browser.evaluate(
        "document.getElementById('loading').hidden && document.getElementById('failure').hidden"
    )
    assert browser.evaluate("document.title") == '<i>"two" & one'
    assert browser.evaluate("document.querySelector('h1').textContent") == '<i>"two" & one'


def test_the_curve_is_the_evaluation_s(browser, page):
    V, V_star = (open_clip(path) for path in page[1])
    shown = np.array(browser.evaluate("Array.from(garmentViewer.clips[0].values)"))
    np.testing.assert_allclose(shown, rmse_per_frame(V, V_star), rtol=1e-5)
    legend = browser.evaluate("document.querySelector('.legend').textContent")
    assert f"RMSE {rmse(V, V_star):.2f} cm" in legend


def open_clip(path):
    with open_sequence(path) as clip:
        return clip.read(0, clip.frames) - clip.motion.root[:, None]


def test_positions_in_the_page_are_the_file_s(browser, page):
    V = open_clip(page[1][1])
    steps = np.array(browser.evaluate("Array.from(garmentViewer.clips[1].steps)")).reshape(V.shape)
    np.testing.assert_allclose(steps * 5e-5, V, atol=1e-6)


def test_marks_are_those_measured(browser):
    counts = browser.evaluate(
        "(() => { const c = garmentViewer.clips[0]; const w = Math.ceil(c.vertices / 8);"
        " return [c.marks.inside.length / w, c.marks.crossing.length / w,"
        " document.querySelector('.label .inside').textContent]; })()"
    )
    assert counts[:2] == [20, 20]
    assert re.fullmatch(r"\d+ vert\w+ inside \(.* %\), \d+ vert\w+ through itself \(.* %\)", counts[2])


def test_it_plays_and_stops(browser):
    browser.evaluate("garmentViewer.goTo(0)")
    browser.press(" ", "Space", " ")
    assert browser.evaluate(MOVED)
    browser.press(" ", "Space", " ")
    assert browser.evaluate("garmentViewer.player.playing") is False


def test_one_clip_plays_by_itself_unless_motion_is_unwelcome(browser, page, tmp_path):
    view_files(page[1][:1], tmp_path / "one.html")
    for calm in (False, True):
        value = "reduce" if calm else "no-preference"
        features = [{"name": "prefers-reduced-motion", "value": value}]
        browser.call("Emulation.setEmulatedMedia", features=features)
        browser.open(tmp_path / "one.html")
        assert browser.evaluate("garmentViewer.player.playing") is not calm
    browser.open(page[0])
    assert browser.evaluate("garmentViewer.player.playing") is False
    browser.resize(1280, 800)


def test_keys_go_frame_by_frame(browser):
    browser.evaluate("garmentViewer.goTo(5)")
    browser.press("ArrowRight", "ArrowRight")
    browser.press("ArrowRight", "ArrowRight")
    browser.press("ArrowLeft", "ArrowLeft")
    assert browser.evaluate("garmentViewer.player.frame") == 6
    browser.press("End", "End")
    assert browser.evaluate("garmentViewer.player.frame") == 19
    assert browser.evaluate("document.getElementById('clock').textContent").startswith(
        "frame 19 of 19, 0.63 s"
    )
    browser.press("Home", "Home")
    assert browser.evaluate("document.getElementById('scrub').value") == "0"


def test_a_click_on_the_curve_goes_there(browser):
    x, y, right, _ = browser.evaluate(BOX % "curve")
    browser.click(x + 46 + (right - x - 56) * 10 / 19, y + 30)
    assert browser.evaluate("garmentViewer.player.frame") == 10


def test_the_picture_shows_what_is_chosen(browser):
    browser.evaluate("garmentViewer.goTo(3)")
    plain = stage(browser)
    middle = plain.shape[1] // 2
    red, blue = plain[..., 0] - plain[..., 2], plain[..., 2] - plain[..., 0]
    assert (red[:, :middle] > 60).sum() > 500  # the prediction at the left
    assert (blue[:, middle:] > 60).sum() > 500  # the truth at the right
    assert (red[:, middle:] > 60).sum() < 0.1 * (red[:, :middle] > 60).sum()  # marks only
    for key in "ebw":
        browser.press(key, f"Key{key.upper()}")
        assert np.abs(stage(browser) - plain).max(axis=-1).mean() > 0.2, key
        browser.press(key, f"Key{key.upper()}")
        assert np.abs(stage(browser) - plain).max() <= 2, key
    browser.press("o", "KeyO")
    over = stage(browser)
    assert (
        (over[..., 0] - over[..., 2] > 30).any(axis=0) & (over[..., 2] - over[..., 0] > 30).any(axis=0)
    ).any()
    browser.press("o", "KeyO")


def test_the_error_s_end_can_be_set(browser):
    browser.press("e", "KeyE")
    assert browser.evaluate("document.getElementById('scale').hidden") is False
    browser.evaluate(SCALE % "500")
    pale = stage(browser).sum()
    browser.evaluate(SCALE % "0.1")
    assert stage(browser).sum() < pale
    browser.press("e", "KeyE")


def test_it_fits_a_phone_in_the_dark(browser):
    browser.resize(390, 844)
    browser.press("t", "KeyT")
    wide = browser.evaluate("document.documentElement.scrollWidth")
    assert wide <= 390
    assert np.median(picture(browser)) < 80
    browser.press("t", "KeyT")
    browser.resize(1280, 800)
    assert browser.complaints() == []
