"""A sequence file as a film, .mp4, .webp or .gif, or as one picture of it, .png; the whole body in view."""

import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from garment_jax.evaluation.animation import film_frames, save_gif, save_webp
from garment_jax.evaluation.colours import body_colours, garment_colours
from garment_jax.evaluation.portrait import frame_portrait
from garment_jax.evaluation.view import (
    body_at,
    camera_at,
    frame_clips,
    outermost_frames,
    picture,
    read_frames,
)
from garment_jax.io.sequence import Sequence, chosen_frames, open_sequence
from garment_jax.storage.whole import written_whole

FPS = {".gif": 15.0, ".webp": 15.0, ".mp4": 30.0}
SUPERSAMPLING = 2
_SMALLEST, _LARGEST = 32, 4096  # pixels


def film_file(
    path: str | Path,
    out: str | Path,
    *,
    height: int = 480,
    azimuth: float = 35.0,
    start: int = 0,
    stop: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Path:
    """Write the film `out` of frames `start … stop - 1` of a sequence file, `height` pixels high; return it.

    The camera follows the body and keeps its direction, `azimuth` degrees from the first frame's front. A
    .mp4 (30 frames a second) needs ffmpeg; a .webp and a .gif have 15. `progress` is called with the frames
    drawn and those to draw, `say` with what is done after them. Raises `ValueError` or `OSError` in one
    sentence; then nothing is written.
    """
    out = Path(out)
    suffix = out.suffix.lower()
    check_height(height)
    with open_sequence(path) as clip, written_whole(out) as (made,):
        rate = min(FPS[suffix], clip.fps)
        frames = np.array(chosen_frames(clip, start, stop))
        seconds = len(frames) / clip.fps
        shown = frames[film_frames(len(frames), clip.fps, film_fps=FPS[suffix], seconds=seconds)]
        pictures = _pictures(clip, shown, height, azimuth, progress, say)
        if suffix == ".gif":
            save_gif(made, pictures, film_fps=rate)
        elif suffix == ".webp":
            save_webp(made, pictures, film_fps=rate)
        else:
            _save_mp4(made, pictures, rate)
    return out


def still_file(
    path: str | Path, out: str | Path, *, height: int = 480, start: int = 0, stop: int | None = None
) -> Path:
    """Write the picture `out`, a PNG, of the middle one of frames `start … stop - 1` and return it."""
    check_height(height)
    with open_sequence(path) as clip, written_whole(Path(out)) as (made,):
        frames = chosen_frames(clip, start, stop)
        frame = frames[len(frames) // 2]
        garment = read_frames(clip, np.array([frame]))[0]
        made.write_bytes(frame_portrait(clip.scene, clip.motion, frame, garment, height=height))
    return Path(out)


def find_ffmpeg() -> str:
    """Return the program that writes .mp4: on the PATH, or of the package imageio-ffmpeg.

    Raises `ValueError` where there is none.
    """
    if found := shutil.which("ffmpeg"):
        return found
    if find_spec("imageio_ffmpeg"):
        from imageio_ffmpeg import get_ffmpeg_exe  # type: ignore[import-not-found]  # optional

        return get_ffmpeg_exe()
    raise ValueError(".mp4 needs ffmpeg, which is not here; pip install imageio-ffmpeg, or write a .webp.")


def check_height(height: int) -> None:
    """Raise `ValueError` for a picture's height out of range."""
    if not _SMALLEST <= height <= _LARGEST:
        raise ValueError(f"--height {height} must lie between {_SMALLEST} and {_LARGEST} pixels; try 480.")


def _pictures(
    clip: Sequence,
    shown: np.ndarray,
    height: int,
    azimuth: float,
    progress: Callable[[int, int], None] | None,
    say: Callable[[str], None],
) -> Iterator[np.ndarray]:
    """Yield the pictures `[h, w, 3]` uint8 of frames `shown`, one frame in memory at a time."""
    probes = outermost_frames([clip], shown, azimuth=azimuth)
    bodies, root, yaw = body_at(clip, probes)
    garments = [read_frames(clip, probes)]
    framing = frame_clips(
        bodies, garments, root, yaw, height=height, azimuth=azimuth, follow=False, whole_body=True
    )
    scene, skin = clip.scene, body_colours(clip.scene.body)
    (colour,) = garment_colours([str(clip.attributes.get("kind"))])
    for done, frame in enumerate(shown, 1):
        here = np.array([frame])
        body, root, yaw = body_at(clip, here)
        camera = camera_at(framing, root[0], float(yaw[0]), supersampling=SUPERSAMPLING)
        yield picture(
            body[0], scene.body.faces, skin, read_frames(clip, here)[0], scene.garment.faces, colour, camera,
            floor=framing.floor, supersampling=SUPERSAMPLING,
        )  # fmt: skip
        if progress is not None:
            progress(done, len(shown))
    say("encoding")  # a .webp or .gif begins only now


def _save_mp4(path: Path, pictures: Iterable[np.ndarray], fps: float) -> None:
    """Write `pictures` `[h, w, 3]` uint8 as H.264, whose sides have to be even."""
    pictures = iter(pictures)
    first = next(pictures)
    h, w = first.shape[0] // 2 * 2, first.shape[1] // 2 * 2
    command = [find_ffmpeg(), "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{w}x{h}", "-r", f"{fps:g}", "-i", "-", "-c:v", "libx264", "-pix_fmt", "yuv420p"]
    command += ["-crf", "18", "-movflags", "+faststart", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            for pixels in (first, *pictures):
                process.stdin.write(np.ascontiguousarray(pixels[:h, :w]).tobytes())
            process.stdin.close()
        except BrokenPipeError:  # it says why itself
            pass
        except BaseException:
            process.kill()
            raise
        said = process.stderr.read().decode(errors="replace").strip()
        if process.wait():
            raise OSError(f"ffmpeg could not write {path.name} ({said[-200:]}); write a .webp instead.")
