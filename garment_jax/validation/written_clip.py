"""The last look at a clip that was imported, before it takes its place: what `validate` calls an error."""

from pathlib import Path

import numpy as np

from garment_jax.body.kinematics import joint_positions, pose_points
from garment_jax.body.up_axis import TO_Y
from garment_jax.importers.finding import Finding
from garment_jax.validation.clip_checks import check_clip
from garment_jax.validation.cloth_checks import PIN_WRONG
from garment_jax.validation.raw_clip import RawClip

_FRAMES = 20  # in which another axis is tried

# an imported clip's faults are mended by what `import` is told
_FOREIGN = {
    "body unit": "give its unit with --body-unit",
    "garment unit": "give its unit with --garment-unit",
    "root unit": "give the motion's unit with --motion-unit",
    "frames unit": "give the clip's unit with --clip-unit",
    "up axis": "say which axis is up with --motion-up or --body-up",
}
_PACKED = "pack the clip again in metres, Y up, all of one simulation"


def refuse_errors(path: Path, where: str, *, packed: bool = False) -> None:
    """Raise `ValueError`, about `where`, for the first error that the sequence file at `path` has.

    `packed`: a clip that says its units and axes itself, for which `import` has no options.
    """
    try:
        with RawClip(path) as clip:
            faults = [finding for finding in check_clip(clip, warn=False) if finding.severity == "error"]
            axis = _other_axis(clip) if faults and faults[0].check == "pins" else None
    except (ValueError, OSError) as error:
        raise ValueError(str(error).replace(str(path), where)) from error
    if not faults:
        return
    fault = faults[0]
    if axis is not None and not packed:
        said = f"{fault.value}, and where it carries them with {axis} up in the clip"
        fault = fault._replace(value=said, remedy=f"give --clip-up {axis}")
    elif packed and fault.check in _FOREIGN:
        fault = fault._replace(remedy=_PACKED)
    raise ValueError(_import_remedy(fault).sentence(where))


def _import_remedy(fault: Finding) -> Finding:
    return (
        fault if fault.remedy == _PACKED else fault._replace(remedy=_FOREIGN.get(fault.check, fault.remedy))
    )


def _other_axis(clip: RawClip) -> str | None:
    """Return the up axis with which the frames' pins are about where the body carries them, or None.

    The motion's axis is settled: a body that does not stand is an error of its own.
    """
    pins, body = clip.scene.pins, clip.scene.body
    if pins is None or not len(pins.vertices):
        return None
    frames = np.unique(np.linspace(0, clip.frames - 1, _FRAMES).astype(int))
    R, root = clip.motion.rotations[frames], clip.motion.root[frames]
    template = clip.scene.garment.template[pins.vertices]
    carried = pose_points(template, pins.weights, R, joint_positions(R, root, body), body.joints)
    shown = np.array([clip.read(k, k + 1)[0, pins.vertices] for k in map(int, frames)])
    for axis, turn in (("Z", TO_Y["Z"]), ("Y", TO_Y["Z"].T)):
        if np.linalg.norm(shown @ turn.T - carried, axis=-1).max() <= PIN_WRONG:
            return axis
    return None
