"""The user's garment and body for imported clips: read once, converted, dressed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from garment_jax.body.retarget import read_joint_table
from garment_jax.importers.bodies import LoadedBody, place_template, read_any_body
from garment_jax.importers.garment_mesh import load_garment
from garment_jax.importers.kinds import CACHES, in_order
from garment_jax.importers.motions import SUFFIXES, read_motion
from garment_jax.importers.scenes import DressedScene, dress
from garment_jax.importers.sources import Options
from garment_jax.importers.units import metres_per_unit, settle_unit, to_metres_y_up
from garment_jax.io.validation import FARTHEST
from garment_jax.structs import Garment, Motion, RiggedBody

_FAR = 0.5  # metres from the body in the median: the template is not on it
MESHES = (".obj", ".ply")  # a body that is vertices alone


class Place(NamedTuple):
    """Where a file's points are in the package's world."""

    metres: float
    up: str
    notes: tuple[str, ...]

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return `points` `[..., 3]` in metres, Y up, float32."""
        with np.errstate(over="ignore"):  # what float32 cannot hold is infinite, and refused as such
            points = np.asarray(points, np.float32)
        return to_metres_y_up(points, self.metres, self.up)


def settle_place(
    options: Options,
    part: str,
    points: np.ndarray,
    path: Path,
    *,
    unit: float | None = None,
    up: str | None = None,
) -> Place:
    """Return how `points` `[n, 3]` of a file are converted: as the user says, else the file.

    Where neither says it: metres, for what is then as large as a garment, and Y up; the notes say so.
    Raises `ValueError` for points that are not finite, and for another size whose unit nobody says.
    """
    bad = ~(np.abs(points) < FARTHEST).all(axis=1)  # nor NaN
    if bad.any():
        first = int(bad.argmax())
        raise ValueError(
            f"{path}: vertex {first} of its first frame is {points[first].tolist()}; export it again."
        )
    extent = float(np.ptp(points, axis=0).max())
    settled = settle_unit(unit, options.unit.get(part), extent, str(path), f"--{part}-unit")
    axis = options.up.get(part) or up
    notes = (settled.note,) if settled.note else ()
    if axis is None:
        notes += (f"{path} does not say its up axis: taken for Y (--{part}-up Z says otherwise)",)
    return Place(settled.metres, axis or "Y", notes)


def of_one_file(options: Options, parts: tuple[str, ...], path: Path) -> Options:
    """Return `options` where a unit or an up axis that is given for one of `parts` holds for all of them.

    The parts are those of a clip that are in one file. Raises `ValueError` where two are given that differ.
    """
    changed = {}
    for what in ("unit", "up"):
        given: Mapping[str, str] = getattr(options, what)
        said = {part: given[part] for part in parts if part in given}
        alike = {metres_per_unit(v, f"--{p}-unit") if what == "unit" else v for p, v in said.items()}
        if len(alike) > 1:
            words = " and ".join(f"--{part}-{what} {value}" for part, value in said.items())
            raise ValueError(f"{path}: {words} speak of one file; leave out the one that is wrong.")
        changed[what] = {**given, **{part: value for value in said.values() for part in parts}}
    return options._replace(**changed)


def is_same(one: Path, other: Path) -> bool:
    """Return whether two paths are one file, or the first is a frame of the folder of meshes `other`."""
    return (
        other.resolve() in (one.resolve(), one.resolve().parent)
        if other.is_dir()
        else (one.resolve() == other.resolve())
    )


class Wardrobe:
    """The garment and the body that the options name; each is read once, a SMPL body once for each shape."""

    def __init__(
        self, options: Options, *, garment: Path | None = None, motions: Sequence[Path] = ()
    ) -> None:
        """`garment` is the format's own template; `motions` are the files that `motion` will be asked for.

        Raises `ValueError` where garment or body is not named, and as `of_one_file` where the body's file is
        one of the motions.
        """
        self.options = self._body_options = options
        for name, value in (("garment", garment or options.garment), ("body", options.body)):
            if value is None:
                raise ValueError(f"--{name} is not given; name the {name} that the clips show.")
        self.garment_path, self.body_path = Path(options.garment or garment or ""), Path(options.body or "")
        if any(is_same(self.body_path, motion) for motion in motions):
            self._body_options = of_one_file(options, ("body", "motion"), self.body_path)
        self._dressed: dict[bytes, tuple[DressedScene, np.ndarray]] = {}

    def files(self) -> tuple[Path, ...]:
        """Return the files that every clip depends on."""
        o = self.options
        pins = Path(o.pins) if o.pins and o.pins.endswith(".npz") else None
        return tuple(path for path in (self.garment_path, self.body_path, o.collider, o.joints, pins) if path)

    def dressed(self, betas: np.ndarray | None = None, body: RiggedBody | None = None) -> DressedScene:
        """Return the scene of a SMPL body in the shape `betas` `[k]`, or of a `body` that is there."""
        return self._dress(betas, body)[0]

    def motion(
        self,
        path: Path,
        betas: np.ndarray | None = None,
        *,
        fps: float | None = None,
        source_fps: float | None = None,
        centre: bool = False,
    ) -> tuple[Motion, tuple[str, ...]]:
        """Return a motion of the body, at `fps` (None: its own), and what was decided.

        `source_fps`: the file's true rate, where its reader knows better than the user's option.
        """
        dressed, origin = self._dress(betas)
        o = self.options
        # the motion in the body's own file is that of the body that was chosen there, in its unit and axes
        own: dict[str, str | None] = {}
        if is_same(path, self.body_path):
            own = {"mesh": o.mesh.get("body"), "skeleton": o.skeleton.get("body")}
            o = of_one_file(o, ("body", "motion"), path)
        notes: list[str] = []
        motion = read_motion(
            path,
            dressed.scene.body,
            fps=fps,
            source_fps=source_fps or o.source_fps,
            joints=None if o.joints is None else read_joint_table(o.joints),
            skip=o.skip,
            floor=o.floor,
            centre=centre,
            unit=o.unit.get("motion"),
            up=o.up.get("motion"),
            rest_up=o.up.get("body"),
            origin=origin,
            animation=o.animation,
            mesh=o.mesh.get("motion", own.get("mesh")),
            skeleton=o.skeleton.get("motion", own.get("skeleton")),
            rest_frame=o.rest_frame,
            say=notes.append,
        )
        return motion, tuple(notes)

    def _dress(
        self, betas: np.ndarray | None, body: RiggedBody | None = None
    ) -> tuple[DressedScene, np.ndarray]:
        key = b"" if betas is None else np.asarray(betas, np.float64).tobytes()
        if key not in self._dressed:
            loaded = self._body(betas) if body is None else LoadedBody(body, np.zeros(3), ())
            garment, notes = self._garment(loaded)
            dressed = dress(
                garment,
                loaded.body,
                garment_path=self.garment_path,
                body_path=self.body_path,
                collider=self.options.collider,
                pins=self.options.pins,
            )
            notes = (*loaded.notes, *notes, *dressed.notes)
            self._dressed = {key: (dressed._replace(notes=notes), loaded.origin)}
        return self._dressed[key]

    def _body(self, betas: np.ndarray | None) -> LoadedBody:
        o = self._body_options
        return read_any_body(
            self.body_path,
            betas=betas,
            unit=o.unit.get("body"),
            up=o.up.get("body"),
            mesh=o.mesh.get("body"),
            skeleton=o.skeleton.get("body"),
            part="body",
        )

    def _garment(self, loaded: LoadedBody) -> tuple[Garment, tuple[str, ...]]:
        """Return the garment on the canonical body, metres, and what was settled."""
        path, o = self.garment_path, self.options
        garment, findings = load_garment(
            path, unwrap=o.unwrap, fit_uv=o.fit_uv, drop_duplicates=o.drop_duplicates
        )
        place = settle_place(o, "garment", garment.template, path)
        stands = place(garment.template)
        template = place_template(stands, loaded)
        check_on_body(template, loaded.body, path, remedy="or give --garment-unit and --garment-up")
        lift = float(np.abs(template - stands).max())
        notes = [f"{path}: {f.check}: {f.value}" for f in findings if f.severity in ("note", "warning")]
        notes += [note for note in place.notes if "up axis" not in note or "garment" in o.up]
        notes += [f"{path} was moved up by {lift:.3f} m, as its body was"] if lift else []
        return garment._replace(template=template), tuple(notes)


def list_motions(options: Options) -> list[Path]:
    """Return the motions that the options name, or those in the folders named; else the body's own.

    Raises `ValueError` where there are none, `FileNotFoundError` for one that is not there.
    """
    body = options.body
    if not options.motions:
        if body is not None and body.suffix.lower() in (".glb", ".gltf", ".fbx"):
            return [body]
        raise ValueError("--motion is not given; name the motions of the clips, by the clips' names.")
    readable = CACHES if body is not None and body.suffix.lower() in MESHES else SUFFIXES
    found: list[Path] = []
    for path in options.motions:
        if not path.exists():
            raise FileNotFoundError(f"{path} is not there; name motions, or folders of them, with --motion.")
        frames = (
            readable == CACHES and path.is_dir() and any(p.suffix.lower() in MESHES for p in path.iterdir())
        )
        inside = path.is_dir() and not frames  # a mesh a frame is one motion
        found += (
            [p for p in in_order(list(path.iterdir())) if p.suffix.lower() in readable] if inside else [path]
        )
    if not found:
        raise FileNotFoundError(
            f"{', '.join(map(str, options.motions))} holds no motions ({' '.join(readable)})."
        )
    return found


def check_with_cloth(options: Options, path: Path, *, own_motion: bool = False) -> None:
    """Raise `ValueError` for options that move the body and not its cloth; `own_motion`: both in one file."""
    if options.floor:
        raise ValueError(f"{path}: --floor would lift the body out of its cloth; leave it out.")
    if options.skip and own_motion:
        raise ValueError(
            f"{path}: --skip {options.skip} would drop frames of the body and not of its cloth; leave it out."
        )


def check_on_body(template: np.ndarray, body: RiggedBody, path: Path, *, remedy: str) -> None:
    """Raise `ValueError` for a template `[n, 3]` that is nowhere near the body in its canonical pose."""
    apart = float(np.median(KDTree(body.vertices).query(template)[0]))
    if apart > _FAR:
        raise ValueError(
            f"{path}: the template is {apart:.2f} m from the body; put it on the body's rest pose, {remedy}."
        )
