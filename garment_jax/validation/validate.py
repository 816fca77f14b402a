"""What is wrong with files that a user brings: each is looked at by its kind, none stops the others."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from garment_jax.importers.bodies import read_any_body
from garment_jax.importers.finding import Finding, Repair, refusal
from garment_jax.importers.garment_mesh import prepare_garment
from garment_jax.io.formats.any_mesh_cache import SUFFIXES as CACHES
from garment_jax.io.formats.any_mesh_cache import read_cache
from garment_jax.io.formats.damage import reading
from garment_jax.io.formats.gltf import holds_motion_alone, read_animation
from garment_jax.io.formats.npz import npz_names, read_npz
from garment_jax.io.formats.pickles import load_pickle
from garment_jax.io.layout import BODY, check_fields, check_parents
from garment_jax.io.npz import load_body
from garment_jax.io.obj import read_garment
from garment_jax.structs import RiggedBody
from garment_jax.validation.body_checks import LARGEST, SMALLEST, body_unit, body_up, check_body, extent
from garment_jax.validation.clip_checks import check_clip
from garment_jax.validation.clip_set import ClipFacts, check_set, clip_facts
from garment_jax.validation.gltf_checks import check_animation
from garment_jax.validation.motion_arrays import check_motion_arrays
from garment_jax.validation.motion_checks import READ, check_bvh, is_motion
from garment_jax.validation.point_checks import check_points, garment_unit
from garment_jax.validation.raw_clip import RawClip

KNOWN = (".h5", ".obj", ".bvh", ".npz", ".pkl", ".glb", ".gltf", *CACHES)
_RAISED = (ValueError, OSError)
_MODEL = ("v_template", "shapedirs", "J_regressor")  # of a SMPL body


class Report(NamedTuple):
    """One file's findings."""

    path: str  # or "all clips"
    kind: str  # "sequence", "garment", "body", "motion", "mesh sequence", "collider", "pins", "unknown"
    findings: list[Finding]


class Options(NamedTuple):
    """What the user adds to the files."""

    fps: float | None = None  # true rate of motions whose header lies
    garment: Path | None = None  # template that mesh sequences are compared with
    mesh: str | None = None  # the one to take of files that hold several
    skeleton: str | None = None  # the same
    animation: str | None = None  # the same


def list_files(paths: Sequence[Path]) -> list[Path]:
    """Return the files to look at: those named, and those that are read inside folders named.

    A folder of numbered OBJ or PLY files is one mesh sequence. A path that is not there, and a folder without
    any such file, stay in the list: each is a finding like others.
    """
    found: list[Path] = []
    for path in paths:
        found += (path.is_dir() and list(_inside(path))) or [path]
    return list(dict.fromkeys(found))


def validate_files(paths: Sequence[Path], options: Options = Options()) -> Iterator[Report]:
    """Yield the findings on each file as it is done, and last those on all clips together.

    A file that cannot be read is a finding, not an exception.
    """
    template = None if options.garment is None else read_garment(options.garment, uv_required=False).template
    clips: list[ClipFacts] = []
    for path in paths:
        yield validate_file(path, options, template=template, facts=clips)
    if len(clips) > 1:
        yield Report("all clips", "set", check_set(clips))


def validate_file(
    path: Path,
    options: Options = Options(),
    *,
    template: np.ndarray | None = None,
    facts: list[ClipFacts] | None = None,
) -> Report:
    """Return the findings on one file; what is compared between clips is added to `facts`."""
    checks: dict[str, Callable[[], tuple[str, list[Finding]]]] = {
        ".h5": lambda: ("sequence", _check_clip(path, options, facts)),
        ".obj": lambda: ("garment", check_garment(path)),
        ".bvh": lambda: ("motion", check_bvh(path, fps=options.fps)),
        ".npz": lambda: _check_npz(path, options),
        ".pkl": lambda: _check_pickle(path, options),
        ".glb": lambda: _check_gltf(path, options),
        ".gltf": lambda: _check_gltf(path, options),
    }
    suffix, kind = path.suffix.lower(), "unknown"
    try:
        with reading(path):
            _check_there(path)
            if path.is_dir() or suffix in CACHES:
                kind, found = "mesh sequence", _check_cache(path, options, template)
            elif suffix in checks:
                kind, found = checks[suffix]()
            else:
                raise ValueError(f"{path}: {suffix or 'no ending'} is not read; it reads {', '.join(KNOWN)}.")
    except _RAISED as error:
        found = [refusal(error, path)]
    return Report(str(path), kind, found)


def _check_there(path: Path) -> None:
    if not path.exists():
        raise FileNotFoundError(f"{path} is not there; name files or folders to validate.")
    if path.is_dir() and not list(_inside(path)):
        raise FileNotFoundError(f"{path} holds none of {', '.join(KNOWN)}; name the files' own folder.")


def check_garment(path: Path) -> list[Finding]:
    """Return the findings on a garment's OBJ file."""
    garment, findings = prepare_garment(path)
    size = extent(garment.template)
    if SMALLEST <= size <= LARGEST:
        return [Finding("garment unit", "ok", f"{size:.2f} m large"), *findings]
    unit = garment_unit(size)
    scale = {"cm": 0.01, "mm": 0.001}.get(unit or "")
    guess = f"looks like {unit}" if unit else "is that of no garment in metres, cm or mm"
    finding = Finding(
        "garment unit",
        "error",
        f"the garment is {size:.4g} large, which {guess}",
        remedy="convert it to metres" + (" (--fix does)" if scale else ""),
        repair=None if scale is None else Repair("unit", scale),
    )
    return [finding, *findings]


def check_rigged(body: RiggedBody) -> list[Finding]:
    """Return the findings on a body: unit and up axis first, the rest as if these were right."""
    unit, up = body_unit(body), body_up(body)
    if unit.repair is not None:
        scale = np.float32(unit.repair.amount)
        body = body._replace(vertices=body.vertices * scale, joints=body.joints * scale)
    if up == "Y":
        return [unit, Finding("up axis", "ok", "Y"), *check_body(body)]
    turned = Finding(
        "up axis", "error", "the body stands along Z", remedy="turn it so that Y is up and it faces +Z"
    )
    return [unit, turned, *(f for f in check_body(body) if f.check != "canonical floor")]


def _inside(folder: Path) -> Iterator[Path]:
    files = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    frames = [
        path for path in files if path.suffix.lower() in (".obj", ".ply") and path.stem[-1:].isdecimal()
    ]
    if len(frames) > 1:
        yield folder
        files = [path for path in files if path not in frames]
    for path in files:
        if path.is_dir():
            yield from _inside(path)
        elif path.suffix.lower() in KNOWN:
            yield path


def _check_clip(path: Path, options: Options, facts: list[ClipFacts] | None) -> list[Finding]:
    with RawClip(path) as clip:
        if options.fps is not None:
            clip.repair(Repair("fps", options.fps))
        found = check_clip(clip)
        if facts is not None:
            facts.append(clip_facts(clip))  # as it is with its repairs: only the content counts
        return found


def _check_npz(path: Path, options: Options) -> tuple[str, list[Finding]]:
    names = set(npz_names(path))
    if "skin_weights" in names:
        arrays = read_npz(path, RiggedBody._fields)
        missing = [name for name in RiggedBody._fields if name not in arrays]
        if missing:
            load_body(path)
        return "body", check_rigged(lenient_body(arrays, path))
    if names.issuperset(_MODEL):
        return "body", _check_any_body(path)
    if is_motion(dict.fromkeys(names, True)):
        return "motion", check_motion_arrays(path, read_npz(path, READ), fps=options.fps)
    if {"pins", "pin_weights"} <= names or {"body_vertices", "faces"} <= names:
        return "part", [Finding("readable", "ok", f"arrays {', '.join(sorted(names))}")]
    raise ValueError(
        f"{path} holds {', '.join(sorted(names)[:6]) or 'no array'}, which is no body or motion that "
        "is read; see docs/formats.md for their arrays."
    )


def lenient_body(arrays: dict[str, np.ndarray], path: Path) -> RiggedBody:
    """Return the body with its weights as they are, everything else checked by `load_body`'s rules."""
    fields = tuple(f._replace(name=n, sums_to_1=False) for f, n in zip(BODY, RiggedBody._fields, strict=True))
    check_fields(fields, arrays, str(path))
    check_parents(arrays["parents"], str(path), "parents")
    cast: list[Any] = [arrays[field.name].astype(field.dtype) for field in fields]
    body = RiggedBody(*cast)
    return body._replace(joint_names=tuple(str(name) for name in body.joint_names))


def _check_pickle(path: Path, options: Options) -> tuple[str, list[Finding]]:
    content = load_pickle(path)
    if isinstance(content, dict) and set(_MODEL) <= set(content):
        return "body", _check_any_body(path)
    if isinstance(content, dict) and is_motion(content):
        return "motion", check_motion_arrays(path, content, fps=options.fps, content=content)
    raise ValueError(f"{path} holds no poses, vertices or body by names that are read; see docs/formats.md.")


def _check_gltf(path: Path, options: Options) -> tuple[str, list[Finding]]:
    if holds_motion_alone(path):
        found = check_animation(path, fps=options.fps, name=options.animation, skeleton=options.skeleton)
        return "motion", found
    found = _check_any_body(path, mesh=options.mesh, skeleton=options.skeleton)
    if options.animation is not None:
        named = {"name": options.animation, "mesh": options.mesh, "skeleton": options.skeleton}
        moved = read_animation(path, fps=None, source_fps=options.fps, **named)
        found.append(Finding("animation", "ok", f"{len(moved.root)} frames at {moved.fps:g} frames a second"))
    return "body", found


def _check_any_body(path: Path, *, mesh: str | None = None, skeleton: str | None = None) -> list[Finding]:
    loaded = read_any_body(path, mesh=mesh, skeleton=skeleton)
    return [*check_rigged(loaded.body), *(Finding("body parts", "note", note) for note in loaded.notes)]


def _check_cache(path: Path, options: Options, template: np.ndarray | None) -> list[Finding]:
    cache = read_cache(path, mesh=options.mesh)
    given = None if options.fps is None else options.fps / cache.frames_a_sample
    found = check_points(cache.vertices, cache.faces, given or cache.fps, unit=cache.unit, template=template)
    found += [Finding("frames", "note", note) for note in cache.notes]
    if cache.up == "Z":
        found.append(Finding("up axis", "note", "the file says Z", remedy="it is turned when it is imported"))
    return found
