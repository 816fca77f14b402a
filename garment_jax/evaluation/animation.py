"""Pictures as a looping film: a GIF, whose palette bands smooth shading, or a WebP."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image

from garment_jax.evaluation.drawn_by import WRITER

SAMPLES = 8  # pictures that the palette is made from


def film_frames(frames: int, fps: float, *, film_fps: float, seconds: float) -> np.ndarray:
    """Return the clip's frames `[k]` that a film of at most `seconds` shows at `film_fps`.

    The nearest earlier frame at each of the film's own times; a clip slower than the film is shown
    frame by frame.
    """
    step = max(fps / film_fps, 1.0)
    return np.unique(np.arange(0, min(frames, seconds * fps), step).astype(int))


def save_gif(path: Path, pictures: Iterable[np.ndarray], *, film_fps: float, colours: int = 255) -> None:
    """Write `pictures` `[h, w, 3]` uint8 as a looping GIF.

    One palette for all, from pictures spread over the film: palettes of their own flicker, and one
    from the first frame lacks the error's later colours. No dithering: its noise does not compress.
    """
    images = [Image.fromarray(p) for p in pictures]
    chosen = images[:: max(len(images) // SAMPLES, 1)]
    # Each colour once: weighed by its area, the backdrop would take most of the palette.
    inks = np.unique(np.concatenate([np.asarray(image).reshape(-1, 3) for image in chosen]), axis=0)
    palette = Image.fromarray(inks[None]).quantize(colours, method=Image.Quantize.MEDIANCUT)
    small = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    edges = np.round(100.0 * np.arange(len(small) + 1) / film_fps)  # GIF counts hundredths of a second
    small[0].save(
        path,
        format="GIF",
        save_all=True,
        append_images=small[1:],
        duration=[int(d) for d in 10 * np.diff(edges)],
        loop=0,
        comment=WRITER.encode(),
    )


def save_webp(path: Path, pictures: Iterable[np.ndarray], *, film_fps: float, quality: int = 80) -> None:
    """Write `pictures` `[h, w, 3]` uint8 as a looping WebP, in all colours; `quality` from 0 to 100."""
    images = [Image.fromarray(p) for p in pictures]
    edges = np.round(1e3 * np.arange(len(images) + 1) / film_fps)  # milliseconds
    images[0].save(
        path,
        format="WEBP",
        save_all=True,
        append_images=images[1:],
        duration=[int(d) for d in np.diff(edges)],
        loop=0,
        quality=quality,
        method=4,  # 6 takes eighteen times as long for 3 % fewer bytes
    )
