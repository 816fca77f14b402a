"""A sequence file read in spite of its faults, so that each of them can be named, and safe ones repaired.

`data.open_sequence` refuses the first thing that does not fit. The validator wants them all: what can be
assumed for the time being (a frame rate, weights that do not sum to 1) is, and is recorded as a finding.
"""

from pathlib import Path
from types import TracebackType

import h5py
import numpy as np

from garment_jax.body.up_axis import TO_Y
from garment_jax.importers.finding import Finding, Repair
from garment_jax.io import layout
from garment_jax.io.hdf5 import attributes_of, dataset, has, names_in, open_hdf5, read_window
from garment_jax.io.sequence import read_arrays
from garment_jax.io.sequence_writer import MOTION_ONLY
from garment_jax.structs import Motion, Scene

ASSUMED_FPS = 30.0  # where the file has no frame rate: only thresholds depend on it


class RawClip:
    """An open clip; `scene`, `motion` and `read` show it with the repairs made so far.

    Raises like `open_sequence` for what cannot be read at all. `found` holds what was assumed on the way.
    """

    def __init__(self, path: str | Path) -> None:
        self.path, self.found = Path(path), []
        self.repairs: list[Repair] = []
        self._file = open_hdf5(self.path)
        try:
            self.attributes = attributes_of(self._file, str(self.path))
            self._check_version()
            self._arrays = read_arrays(self._file, str(self.path))
            self._vertices, self._scale = self._find_vertices()
            self._total = self._check_frames()
            self._check_layout()
        except BaseException:
            self._file.close()
            raise
        fps = self.attributes.get("fps")
        self.fps = float(fps) if isinstance(fps, int | float) and 0 < fps < 10_000 else None
        self._factor = {"scene": 1.0, "root": 1.0, "frames": 1.0}
        self._canonical, self._world = np.eye(3), np.eye(3)
        self.first, self._last = 0, 0
        self._derive()

    @property
    def frames(self) -> int:
        """Frames that are left."""
        return self._total - self.first - self._last

    @property
    def moves_cloth(self) -> bool:
        """Whether the file holds the garment's vertices that fit its template, not a motion alone."""
        return self._vertices is not None

    @property
    def stored_scale(self) -> float | None:
        """Steps of int16 vertices in metres as the clip is seen, None for float32."""
        return None if self._scale is None else self._scale * self._factor["frames"]

    def read(self, start: int, stop: int) -> np.ndarray:
        """Return frames `start … stop - 1` of those left, `[k, n, 3]` float32 world metres."""
        assert self._vertices is not None
        window = slice(start + self.first, stop + self.first)
        stored = read_window(self._vertices, window.start, window.stop, self.path)
        V = stored.astype(np.float32) * np.float32(self._factor["frames"] * (self._scale or 1.0))
        if self._scale is not None:
            V += (self._factor["root"] * self._arrays["root"][window, None]).astype(np.float32)
        return V if (self._world == np.eye(3)).all() else V @ self._world.T.astype(np.float32)

    def read_extra(self) -> dict[str, np.ndarray]:
        """Return the further per-frame datasets, of the frames that are left."""
        names = names_in(self._file, "extra", str(self.path))
        stop = self._total - self._last
        return {
            name: read_window(
                dataset(self._file, f"extra/{name}", str(self.path)), self.first, stop, self.path
            )
            for name in names
        }

    def repair(self, repair: Repair) -> None:
        """Make one repair: from here on the clip is seen with it."""
        kind, amount = repair
        if kind in ("unit", "root unit", "frames unit"):
            parts = {"unit": ("scene", "root", "frames"), "root unit": ("root",), "frames unit": ("frames",)}
            self._factor |= {part: self._factor[part] * amount for part in parts[kind]}
        elif kind in ("canonical up", "world up", "up"):
            self._canonical = self._canonical if kind == "world up" else TO_Y["Z"]
            self._world = self._world if kind == "canonical up" else TO_Y["Z"]
        elif kind == "weights":
            self._normalise_weights()
        elif kind == "first":
            self.first += int(amount)
        elif kind == "last":
            self._last += int(amount)
        elif kind == "fps":
            self.fps = amount
        self.repairs.append(repair)
        self._derive()

    def close(self) -> None:
        """Close the file; `scene` and `motion` stay usable."""
        self._file.close()

    def __enter__(self) -> "RawClip":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _check_version(self) -> None:
        if has(self._file, "vertices_delta", str(self.path)):
            raise ValueError(f"{self.path} is packed for transport; run `garment-jax import` first.")
        version = self.attributes.get("schema_version")
        if version != layout.SCHEMA_VERSION:
            raise ValueError(
                f"{self.path}: schema_version is {version}, this release reads {layout.SCHEMA_VERSION}; "
                "import the clip again with this release."
            )

    def _find_vertices(self) -> tuple[h5py.Dataset | None, float | None]:
        if self.attributes.get("kind") == MOTION_ONLY:
            return None, None
        data, n = dataset(self._file, "vertices", str(self.path)), len(self._arrays.get("template", ()))
        if data.ndim != 3 or data.shape[2] != 3 or data.dtype not in (np.int16, np.float32):
            raise ValueError(
                f"{self.path}: `vertices` is {data.dtype} {data.shape}; store float32 or int16 [t, n, 3]."
            )
        scale = attributes_of(data, str(self.path)).get("scale") if data.dtype == np.int16 else None
        if data.dtype == np.int16 and not (isinstance(scale, float) and 0 < scale < 1):
            raise ValueError(
                f"{self.path}: attribute scale of `vertices` is {scale!r}; give metres per step."
            )
        if data.shape[1] != n:
            self.found.append(
                Finding(
                    "vertex count",
                    "error",
                    f"frames have {data.shape[1]} vertices, the template has {n}",
                    remedy="take template and frames of one garment, exported without splitting vertices",
                )
            )
            return None, None
        return data, scale

    def _check_frames(self) -> int:
        counts = {name: len(self._arrays[name]) for name in ("root", "rotations") if name in self._arrays}
        counts |= {} if self._vertices is None else {"vertices": self._vertices.shape[0]}
        if not counts:
            raise ValueError(f"{self.path}: dataset `root` is missing; export or import the clip again.")
        total = min(counts.values())
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"`{name}` {count}" for name, count in counts.items())
            self.found.append(
                Finding(
                    "frame count",
                    "error",
                    f"body and garment differ in frames: {listed}",
                    remedy="export both over the same frames; check for one frame more or less, and the rate",
                )
            )
            for name in ("root", "rotations"):
                self._arrays[name] = self._arrays[name][:total]
        return total

    def _check_layout(self) -> None:
        checked = dict(self._arrays)
        for name in ("body/skin_weights", "pins/weights"):  # their sums are a finding of their own
            if name in checked and checked[name].ndim == 2 and np.isfinite(checked[name]).all():
                checked[name] = np.eye(1, checked[name].shape[1]).repeat(len(checked[name]), axis=0)
        if "uv" in checked and np.isfinite(checked["uv"]).all():
            checked["uv"] = np.clip(checked["uv"], 0, 1)
        layout.check_arrays(checked, str(self.path))

    def _normalise_weights(self) -> None:
        for name in ("body/skin_weights", "pins/weights"):
            if name in self._arrays:
                total = self._arrays[name].astype(np.float64).sum(axis=1, keepdims=True)
                self._arrays[name] = (self._arrays[name] / np.where(total > 0, total, 1)).astype(np.float32)

    def _derive(self) -> None:
        """Make `scene` and `motion` anew from what is stored and the repairs."""
        C, W, scene = self._canonical, self._world, layout.to_scene(self._arrays)
        place = self._factor["scene"] * C.T

        def turned(points: np.ndarray) -> np.ndarray:
            return points if (place == np.eye(3)).all() else (points @ place).astype(np.float32)

        body, garment = scene.body, scene.garment
        self.scene = Scene(
            garment._replace(template=turned(garment.template)),
            body._replace(vertices=turned(body.vertices), joints=turned(body.joints)),
            scene.collider,
            scene.pins,
        )
        window = slice(self.first, self._total - self._last)
        rotations, root = self._arrays["rotations"][window], self._arrays["root"][window]
        if not ((np.eye(3) == C).all() and (np.eye(3) == W).all()):
            rotations = (W @ rotations.astype(np.float64) @ C.T).astype(np.float32)
        self.motion = Motion(rotations, self._factor["root"] * root @ W.T, self.fps or ASSUMED_FPS)
