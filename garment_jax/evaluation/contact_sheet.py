"""A contact sheet: frames over time in columns, simulated, predicted and the error in rows."""

from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from garment_jax.evaluation.colours import FAINT, INK, heat

PAPER = (255, 255, 255)


class Row(NamedTuple):
    """One row of pictures."""

    label: str
    pictures: list[np.ndarray]  # [h, w, 3] uint8 each
    captions: list[str]  # one below each picture, may be empty


class Scale(NamedTuple):
    """The error map's colour scale."""

    end_cm: float
    largest_cm: float  # of what is shown; colours stop at end_cm


def font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Return DejaVu Sans, which comes with matplotlib: no system fonts are needed."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def contact_sheet(title: str, heads: list[str], rows: list[Row], scale: Scale | None) -> Image.Image:
    """Return the sheet: `heads` above the columns, row labels at the left, the scale below."""
    height, width, _ = rows[0].pictures[0].shape
    unit = max(height // 30, 9)  # text size; everything else is in proportion
    gap, left, top = unit // 3, 2 * unit, int(4.6 * unit)
    caption = int(1.7 * unit)
    tall = [height + (caption if any(row.captions) else 0) + gap for row in rows]
    below = int(3.4 * unit) if scale else gap
    wide = left + len(heads) * (width + gap)
    sheet = Image.new("RGB", (wide, top + sum(tall) + below), PAPER)
    pen = ImageDraw.Draw(sheet)
    pen.text((left, unit // 2), title, INK, font(int(1.25 * unit), bold=True))
    for column, head in enumerate(heads):
        middle = left + column * (width + gap) + width // 2
        pen.text((middle, top - unit // 2), head, FAINT, font(unit), anchor="ms")
    y = top
    for row, step in zip(rows, tall, strict=True):
        _paste_row(sheet, row, left, y, gap, unit)
        y += step
    if scale:
        _paste_scale(sheet, scale, left, y + unit // 3, wide - left - gap, unit)
    return sheet


def _paste_row(sheet: Image.Image, row: Row, left: int, y: int, gap: int, unit: int) -> None:
    height, width, _ = row.pictures[0].shape
    pen = ImageDraw.Draw(sheet)
    for column, pixels in enumerate(row.pictures):
        x = left + column * (width + gap)
        sheet.paste(Image.fromarray(pixels), (x, y))
        if row.captions:
            at = (x + width // 2, y + height + int(1.25 * unit))
            pen.text(at, row.captions[column], FAINT, font(unit), anchor="ms")
    label = Image.new("RGB", (height, left), PAPER)
    ImageDraw.Draw(label).text((height // 2, left // 2), row.label, INK, font(int(1.1 * unit)), anchor="mm")
    sheet.paste(label.rotate(90, expand=True), (0, y))


def _paste_scale(sheet: Image.Image, scale: Scale, left: int, y: int, width: int, unit: int) -> None:
    """Draw the colour bar with its ticks in cm and the largest error in words."""
    long, thick = width * 2 // 5, int(0.9 * unit)
    bar = heat(np.linspace(0, scale.end_cm, long), scale.end_cm)
    strip = np.broadcast_to((255 * bar).astype(np.uint8), (thick, long, 3))
    sheet.paste(Image.fromarray(np.ascontiguousarray(strip)), (left, y))
    pen = ImageDraw.Draw(sheet)
    for part in np.linspace(0, 1, 5):
        text = f"{part * scale.end_cm:g}" + (" cm" if part == 1 else "")
        pen.text((left + int(part * (long - 1)), y + int(2.1 * unit)), text, INK, font(unit), anchor="ms")
    words = f"distance of vertices between both; largest shown {scale.largest_cm:.1f} cm"
    if scale.largest_cm > scale.end_cm:
        words += f", all beyond {scale.end_cm:g} cm in the last colour"
    pen.text((left + long + 3 * unit, y + thick // 2), words, FAINT, font(unit), anchor="lm")
