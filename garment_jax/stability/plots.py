"""The report's pictures; matplotlib is imported here and nowhere else in this room."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from garment_jax.stability.case import Curve
from garment_jax.storage.whole import written_whole


class Style(NamedTuple):
    """How one picture is drawn."""

    title: str
    x: str
    y: str
    x_log: bool
    y_log: bool
    line: float | None = None  # a bound, drawn across
    markers: bool = True


STYLES = {
    "skinning": Style(
        "Two rotations blended half and half", "angle between them, degrees", "", False, True, 10.0
    ),
    "margins": Style("Margin of the collision solver", "ε, m", "mm (0 drawn as 1e-4)", True, True, 0.1),
    "strain": Style(
        "Edge strain of extreme motion", "frame of the part", "99th percentile, %", False, True, 30.0, False
    ),
    "recovery": Style(
        "Back to normal",
        "frames since the calm pose",
        "RMSE from that pose reached slowly, cm",
        False,
        True,
        1.0,
        False,
    ),
    "precision": Style(
        "Error against float64", "size: vertices, or frames", "largest error, m or 1", True, True
    ),
    "training": Style("A rate 100 times too high, a NaN", "step", "loss", False, True),
}
SHOWN = 12  # lines with a name of their own; the rest is grey


def save_plots(folder: Path, curves: Sequence[Curve]) -> list[Path]:
    """Write one PNG a picture named in `curves` into `folder`; return the paths."""
    paths = []
    for name in dict.fromkeys(curve.plot for curve in curves):
        path = folder / f"stability_{name}.png"
        _save(path, STYLES[name], [curve for curve in curves if curve.plot == name])
        paths.append(path)
    return paths


def _save(path: Path, style: Style, curves: Sequence[Curve]) -> None:
    figure = Figure(figsize=(9, 4.2), dpi=120, layout="constrained")
    axes = figure.subplots()
    named = _most_telling(curves)
    colours = matplotlib.colormaps["tab20" if len(named) > 10 else "tab10"].colors  # type: ignore[attr-defined]
    for curve in curves:
        if curve not in named:
            axes.plot(curve.x, curve.y, color="0.8", lw=0.8, zorder=1)
    for k, curve in enumerate(named):
        dashed = "--" if curve.label.endswith("bfloat16") else "-"
        marker = "o" if style.markers else ""
        # a routine's two types share their colour
        colour = colours[(k // 2 if style.title.startswith("Error") else k) % len(colours)]
        axes.plot(curve.x, curve.y, ls=dashed, marker=marker, ms=3, lw=1.3, color=colour, label=curve.label)
    if style.line is not None:
        axes.axhline(style.line, color="0.3", lw=1.0, ls=":")
    axes.set(xlabel=style.x, ylabel=style.y, title=style.title)
    axes.set_xscale("log" if style.x_log else "linear")
    axes.set_yscale("log" if style.y_log else "linear")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    with written_whole(path) as (made,):
        figure.savefig(made, format="png")


def _most_telling(curves: Sequence[Curve]) -> list[Curve]:
    """Return the curves that get a name: all where they are few, else those that reach highest."""
    if len(curves) <= 2 * SHOWN:
        return list(curves)
    peaks = [np.nanmax(curve.y) for curve in curves]
    return [curves[k] for k in np.argsort(peaks)[::-1][:SHOWN]]
