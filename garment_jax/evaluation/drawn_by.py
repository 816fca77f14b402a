"""Who drew a picture: a mark in its metadata."""

from PIL.PngImagePlugin import PngInfo

WRITER = "garment-jax render"


def png_text() -> PngInfo:
    """Return the mark as a PNG has it."""
    text = PngInfo()
    text.add_text("Software", WRITER)
    return text
