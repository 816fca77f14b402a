import re

import pytest

from garment_jax.viewer import page
from garment_jax.viewer.page import PageWriter, in_script
from tests.viewer.unpacking import read_page

NASTY = "</title></script><script>alert(1)</script>{{title}} /* style */ & \"' \u2028 ä"


def test_names_can_break_out_of_nothing(tmp_path):
    with PageWriter(tmp_path / "p.html", NASTY) as writer:
        name = writer.add(b"\x78\x9c\x03\x00\x00\x00\x00\x01")
        writer.finish({"title": NASTY, "notes": [NASTY]})
    text = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "alert(1)</script>" not in text
    assert text.count("&lt;/title&gt;") == 2
    facts, blocks = read_page(tmp_path / "p.html")
    assert facts["notes"] == [NASTY]
    assert blocks == {name: b""}
    assert in_script("</Script>&") == '"\\u003c/Script\\u003e\\u0026"'


def test_the_page_fetches_nothing_and_carries_the_licence(tmp_path):
    with PageWriter(tmp_path / "p.html", "x") as writer:
        writer.finish({})
    text = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert not re.search(r"""(src|href)=["'](?!data:)""", text.split("var THREE")[0])
    assert "The MIT License" in text
    assert "/* style */" not in text
    assert "data and scripts" not in text
    assert text.rstrip().endswith("</html>")


def test_no_script_closes_its_element_early():
    for name in ("three.bundle.js", *(f"script/{s}.js" for s in page.SCRIPTS)):
        assert "</script" not in page._own(*name.split("/")).lower(), name


def test_nothing_is_left_after_an_error(tmp_path):
    (tmp_path / "p.html").write_text("older")
    with pytest.raises(KeyboardInterrupt), PageWriter(tmp_path / "p.html", "x"):
        raise KeyboardInterrupt
    assert [p.name for p in tmp_path.iterdir()] == ["p.html"]
    assert (tmp_path / "p.html").read_text() == "older"


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(OSError, match=r"p\.html could not be written"),
        PageWriter(tmp_path / "file" / "p.html", ""),
    ):
        pass
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="folder"), PageWriter(tmp_path / "folder", "") as writer:
        writer.finish({})
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]
