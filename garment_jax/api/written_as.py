"""A sequence file becomes whatever the output's name says: by the viewer, the exporters or the renderer."""

from pathlib import Path
from typing import Any, NamedTuple

from garment_jax.api.outputs import Output, move_into_place
from garment_jax.progress import FrameProgress

NEXT = {
    "html": "open it in a browser",
    "glb": "import it in Blender, Unity or Unreal, or open it in a glTF viewer",
    "usd": "open it in Houdini or usdview, or in Blender with its scene at the clip's rate, such as 30 fps",
    "abc": "import it in Blender, Maya or Houdini",
    "pc2": "import the .obj beside it and give it a point cache (in Blender: modifier Mesh Cache)",
    "mdd": "import the .obj beside it and give it a point cache (in Blender: modifier Mesh Cache)",
    "obj": "import its frames as a sequence",
    "npz": "numpy.load it: vertices, faces, uv, body_vertices",
    "h5": "garment-jax view, export and evaluate read it",
    "mp4": "play it",
    "webp": "open it in a browser",
    "gif": "open it in a browser",
    "png": "look at it",
}


class Shape(NamedTuple):
    """How the output is to be."""

    body: bool = True
    unit: str | None = None  # m, cm or mm
    up: str | None = None  # Y or Z
    blender: str | None = None
    height: int = 480  # pixels of pictures and films
    every: int | None = None  # frames a morph target; None: as few as viewers take
    start: int | None = None  # first frame that is written
    stop: int | None = None  # frame before which to stop
    frame_offset: int | None = None  # number of the first frame


def check_able(formats: set[str], shape: Shape) -> None:
    """Raise `ValueError` or `OSError` for what cannot be written here, before the work is done."""
    if "abc" in formats:
        from garment_jax.io.formats.blender import find_blender

        find_blender(shape.blender)
    if "usd" in formats:
        from garment_jax.io.formats.usd_library import load_pxr

        load_pxr()
    if "mp4" in formats:
        from garment_jax.evaluation.film import find_ffmpeg

        find_ffmpeg()
    if formats & {"mp4", "webp", "gif", "png"}:
        from garment_jax.evaluation.film import check_height

        check_height(shape.height)
    if shape.every is not None and shape.every < 1:
        raise ValueError(f"--every {shape.every} is too small; give 1 (every frame) or more.")
    if shape.every is not None and formats != {"glb"}:
        raise ValueError(f"--every {shape.every} is for .glb, whose frames are morph targets; leave it out.")
    meshes = {"glb", "usd", "abc", "pc2", "mdd", "obj", "npz"}
    for option, value, what, takes in (
        ("--out-unit", shape.unit, "meshes", meshes),
        ("--out-up", shape.up, "meshes", meshes),
        ("--start", shape.start, "pages, pictures and meshes", set(NEXT) - {"h5"}),
        ("--stop", shape.stop, "pages, pictures and meshes", set(NEXT) - {"h5"}),
        ("--frame-offset", shape.frame_offset, "meshes whose frames have numbers", meshes - {"glb"}),
    ):
        if value is not None and not formats & takes:
            raise ValueError(f"{option} {value} is for {what}, not for {', '.join(formats)}; leave it out.")
    if "glb" in formats and (shape.unit or "m", shape.up or "Y") != ("m", "Y"):
        raise ValueError(
            ".glb has metres and Y up, which programs that import it turn to their own; leave --out-unit and "
            "--out-up out."
        )
    if shape.frame_offset is not None:
        from garment_jax.exporters.clip import FARTHEST  # NumPy

        if not 0 <= shape.frame_offset <= FARTHEST:
            raise ValueError(f"--frame-offset {shape.frame_offset} is out of range; give 0 to {FARTHEST}.")


def check_frames(sequence: Path, output: Output, shape: Shape) -> list[str]:
    """Return what a user must know of the frames that will be written of a motion, before they are made.

    Raises `ValueError` where those that are asked for are none of the motion's.
    """
    from garment_jax.io.sequence import chosen_frames, open_sequence

    with open_sequence(sequence) as clip:
        frames = len(chosen_frames(clip, shape.start or 0, shape.stop))
    if output.format != "glb" or shape.every is not None or (every := _fewest(frames)) == 1:
        return []
    return [
        f"{output.path.name}: one frame in {every} is a morph target, as many as viewers take, with straight "
        "lines between, where cloth may enter the body by a centimetre; .usdc and .abc keep every frame, "
        "--every says otherwise"
    ]


def write_as(
    sequence: Path, output: Output, shape: Shape, place: Path, *, title: str, force: bool
) -> list[Path]:
    """Write the animation in `sequence` as `output`, built in the folder `place`; return the files.

    Raises `ValueError` or `OSError` in one sentence; then nothing is written.
    """
    made = place / output.path.name
    if output.format == "h5":
        files = [sequence.rename(made)]
    elif output.format == "html":
        files = [_page(sequence, made, shape, title)]
    elif output.format in ("mp4", "webp", "gif", "png"):
        files = [_pictures(sequence, made, shape, title)]
    else:
        files = _meshes(sequence, made, output.format, shape)
    return move_into_place(files, output.path.parent, force=force)


def _page(sequence: Path, made: Path, shape: Shape, title: str) -> Path:
    from garment_jax.viewer.command import view_files

    cut = {"start": shape.start or 0, "stop": shape.stop}
    return view_files([sequence], made, title=title, body=shape.body, **cut).path


def _pictures(sequence: Path, made: Path, shape: Shape, title: str) -> Path:
    from garment_jax.evaluation.film import film_file, still_file

    asked = {"height": shape.height, "start": shape.start or 0, "stop": shape.stop}
    with FrameProgress(f"{title}, pictures") as progress:
        if made.suffix.lower() == ".png":
            return still_file(sequence, made, **asked)
        return film_file(sequence, made, **asked, progress=progress, say=progress.say)


def _meshes(sequence: Path, made: Path, format: str, shape: Shape) -> list[Path]:
    from garment_jax.exporters.command import export_file
    from garment_jax.io.sequence import chosen_frames, open_sequence

    given: dict[str, Any] = {k: v for k, v in shape._asdict().items() if v is not None and k != "height"}
    frames = made.with_name("frames")  # a folder may be called NAME.obj, `export` would take it for a file
    if format == "glb" and shape.every is None:
        with open_sequence(sequence) as clip:
            given["every"] = _fewest(len(chosen_frames(clip, shape.start or 0, shape.stop)))
    with FrameProgress(made.name) as progress:
        report = export_file(
            sequence, frames if format == "obj" else made, format=format, progress=progress, **given
        )
    return [frames.rename(made)] if format == "obj" else report.files


def _fewest(frames: int) -> int:
    """Return how many frames a morph target stands for, so that viewers take them all."""
    from garment_jax.exporters.glb import MOST_TARGETS

    return -(-max(frames - 1, 1) // MOST_TARGETS)
