"""The documented keys are those of the dataclasses."""

import dataclasses
import re
from pathlib import Path

import pytest

from garment_jax.config import Config
from garment_jax.config.key import metadata
from garment_jax.config.page import configuration_page

PROJECT = Path(__file__).parents[2]
PAGE = PROJECT / "docs" / "configuration.md"
PACKAGE = PROJECT / "garment_jax"
DOCUMENTS = sorted({PROJECT / "README.md", *PAGE.parent.glob("*.md")} - {PAGE.parent / "lab_notes.md"})


def test_every_key_says_what_it_is() -> None:
    sections = [getattr(Config(), field.name) for field in dataclasses.fields(Config)]
    keys = [field for section in sections for field in dataclasses.fields(section)]
    assert [field.name for field in keys if not metadata(field).help] == []


def test_the_page_lists_the_keys_as_they_are() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == configuration_page(), "python -m garment_jax.config.page > docs/configuration.md"
    assert "- `tau = 0.2`: metres; " in page
    assert '- `norm = "cm2"`: `"cm2"` or `"plain"`: mean squared cm ' in page
    assert "- `size = 64`†: " in page
    assert "- `eps = 0.004`‡: " in page


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.name)
def test_keys_in_the_documents_exist(page: Path) -> None:
    sections = {field.name: getattr(Config(), field.name) for field in dataclasses.fields(Config)}
    keys = {(name, field.name) for name, values in sections.items() for field in dataclasses.fields(values)}
    said = re.findall(rf"(?:--|`)({'|'.join(sections)})\.(?!py\b)([a-z_]+)", page.read_text(encoding="utf-8"))
    modules = {(room, name) for room, name in said if (PACKAGE / room / f"{name}.py").exists()}
    assert set(said) - keys - modules == set()
