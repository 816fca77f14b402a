"""The documented keys are those of the dataclasses."""

import dataclasses
from pathlib import Path

from garment_jax.config import Config
from garment_jax.config.key import metadata
from garment_jax.config.page import configuration_page

PAGE = Path(__file__).parents[2] / "docs" / "configuration.md"


def test_every_key_says_what_it_is() -> None:
    sections = [getattr(Config(), field.name) for field in dataclasses.fields(Config)]
    keys = [field for section in sections for field in dataclasses.fields(section)]
    assert [field.name for field in keys if not metadata(field).help] == []


def test_the_page_lists_the_keys_as_they_are() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == configuration_page(), "python -m garment_jax.config.page > docs/configuration.md"
    assert "| tau | `0.2` | above 0 | training | metres; " in page
    assert '| norm | `"cm2"` | `"cm2"`, `"plain"` | training |' in page
    assert "| eps | `0.004` | above 0 | use |" in page
