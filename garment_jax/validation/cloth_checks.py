"""Does a garment's clip hold cloth, on this body, in this vertex order? Findings from one pass over it."""

import numpy as np

from garment_jax.body.frame_windows import stretches
from garment_jax.body.kinematics import joint_positions
from garment_jax.importers.finding import Finding
from garment_jax.importers.jumps import jump_frames
from garment_jax.validation.raw_clip import RawClip
from garment_jax.validation.track_checks import longest_run
from garment_jax.validation.vertex_scan import Scan, scan_clip

STRAIN = 0.25  # absolute relative change of edges, of 99 in 100: beyond it is no cloth
TORN = 4.0  # times its length in the template: a vertex out of its place
SCRAMBLED = 8.0  # the longest hundredth of the edges over the shortest, in every frame: another order
FOLDED = 0.01  # of the faces
FAST = 15.0  # metres per second relative to the root; the hem of a wide skirt reaches 6
STATIC = 1e-4  # metres, as `data.validation`
PIN_ODD, PIN_WRONG = 0.01, 0.05  # metres
_LOOK = "a network's frame: look at it in garment-jax view"
_FROZEN, _BODY_MOVES = 1e-4, 2e-3  # metres a frame: cloth rounded to 0.05 mm steps stands, the body does not


def check_cloth(clip: RawClip, *, warn: bool = True) -> list[Finding]:
    """Return the findings on the garment's vertices, metres, Y up. One fault is told once: what follows from
    a wrong vertex order is not listed beside it. `warn` as in `clip_checks.check_clip`."""
    scan = scan_clip(clip, shape=warn)
    found = [_finite(scan, clip)]
    if not len(scan.sampled):  # all that would be measured is not finite
        return found
    found.append(_static(scan))
    if found[-1].severity == "error":
        return found
    order, jumps = _order(scan, clip), _jumps(scan, clip)
    found += [order, jumps, _frozen(scan, clip)]
    if order.severity == "error" or jumps.severity == "error":
        return found
    torn = _torn(scan, clip)
    shape = [torn] if torn.severity != "ok" or not warn else [torn, _strain(scan, clip), _folded(scan, clip)]
    if clip.attributes.get("kind") == "predicted":  # nothing was simulated
        shape = [one._replace(remedy=one.remedy and _LOOK) for one in shape]
    return [*found, shape[0], _pins(scan, clip), *shape[1:]]


def _at(clip: RawClip, frame: int) -> str:
    return f"frame {frame + clip.first}"


def _finite(scan: Scan, clip: RawClip) -> Finding:
    if not scan.not_finite:
        return Finding("NaN", "ok", "all finite")
    frame, vertex = scan.first_bad
    return Finding(
        "NaN",
        "error",
        f"{scan.not_finite} vertices in {int(scan.bad_frames.sum())} frames are not finite",
        f"{_at(clip, frame)}, vertex {vertex}",
        "cut the clip before that frame, or simulate it again with more substeps",
    )


def _static(scan: Scan) -> Finding:
    if scan.movement >= STATIC:
        return Finding("cloth static", "ok", f"a vertex moves up to {scan.movement:.2f} m")
    return Finding(
        "cloth static",
        "error",
        f"no garment vertex moves more than {1000 * scan.movement:.2g} mm",
        remedy="leave the clip out, or export it again with its animation",
    )


def _order(scan: Scan, clip: RawClip) -> Finding:
    spread = scan.ratio_p99 / np.maximum(scan.ratio_p1, 1e-6)
    if np.median(spread) <= SCRAMBLED or spread.min() <= SCRAMBLED / 2:
        return Finding("vertex order", "ok", "edges are those of the template")
    return Finding(
        "vertex order",
        "error",
        f"in every frame 1 in 100 edges is {scan.ratio_p99[0]:.3g} times its length or more",
        f"{_at(clip, int(scan.sampled[0]))}, vertices {scan.longest[0][0]} and {scan.longest[0][1]}",
        "export template and frames with the same vertex order (importers must be told to keep it)",
    )


def _jumps(scan: Scan, clip: RawClip) -> Finding:
    speed = np.nan_to_num(scan.step, nan=0.0) * clip.motion.fps
    found = jump_frames(speed, FAST)
    if not len(found):
        return Finding("cloth jumps", "ok", f"at most {np.nanmax(scan.step, initial=0.0):.2f} m a frame")
    worst = int(found[speed[found].argmax()])
    return Finding(
        "cloth jumps",
        "error",
        f"a vertex moves {scan.step[worst]:.2f} m in one frame ({speed[worst]:.0f} m/s), {len(found)} times",
        f"{_at(clip, worst)} to {worst + 1 + clip.first}, vertex {scan.vertex[worst]}",
        "cut the clip there, or simulate it again from there",
    )


def _frozen(scan: Scan, clip: RawClip) -> Finding:
    """Cloth that stands in the world, or is carried rigidly, while the body moves under it."""
    moves = np.zeros(max(clip.frames - 1, 0), bool)
    for _, frames in stretches(clip.frames, before=1):
        points = joint_positions(clip.motion.rotations[frames], clip.motion.root[frames], clip.scene.body)
        step = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1, initial=0.0)
        moves[frames.start : frames.stop - 1] = step > _BODY_MOVES
    stands = np.fmin(scan.world_step, scan.step) < _FROZEN
    begin, length = longest_run(stands & moves)
    if length < 5:
        return Finding("cloth frozen", "ok", "never")
    return Finding(
        "cloth frozen",
        "warning",
        f"the garment stands still for {length} frames while the body moves",
        _at(clip, begin),
        "cut these frames, or export garment and body over the same frames",
    )


def _torn(scan: Scan, clip: RawClip) -> Finding:
    k = int(scan.ratio_max.argmax())
    if scan.ratio_max[k] <= TORN:
        return Finding("torn edges", "ok", f"the longest is {scan.ratio_max[k]:.2f} times its length")
    frames = int((scan.ratio_max > TORN).sum())
    return Finding(
        "torn edges",
        "warning",
        f"an edge is {scan.ratio_max[k]:.3g} times its length; so in {frames} of {len(scan.sampled)} "
        "frames looked at",
        f"{_at(clip, int(scan.sampled[k]))}, vertices {scan.longest[k][0]} and {scan.longest[k][1]}",
        "a vertex is out of its place or the cloth was caught: cut the clip before, or simulate it again",
    )


def _strain(scan: Scan, clip: RawClip) -> Finding:
    k = int(scan.strain_p99.argmax())
    said = f"{100 * scan.strain_p99[k]:.0f} % at the 99th percentile of the edges"
    if scan.strain_p99[k] <= STRAIN:
        return Finding("strain", "ok", said, _at(clip, int(scan.sampled[k])))
    return Finding(
        "strain",
        "warning",
        f"{said}; cloth stretches to {100 * STRAIN:.0f}",
        _at(clip, int(scan.sampled[k])),
        "simulate with a stiffer cloth or more substeps; if all frames are so, the template has another size",
    )


def _folded(scan: Scan, clip: RawClip) -> Finding:
    k = int(scan.folded.argmax())
    if scan.folded[k] <= FOLDED:
        return Finding("flipped faces", "ok", f"at most {100 * scan.folded[k]:.2g} %")
    return Finding(
        "flipped faces",
        "warning",
        f"{100 * scan.folded[k]:.2g} % of the faces are turned over on their neighbours",
        _at(clip, int(scan.sampled[k])),
        "the cloth is crumpled or caught there: cut the clip before, or simulate it again",
    )


def _pins(scan: Scan, clip: RawClip) -> Finding:
    if clip.scene.pins is None:
        return Finding("pins", "ok", "none")
    k = int(scan.pin_error.argmax())
    said = f"at most {1000 * scan.pin_error[k]:.2g} mm from where the body carries them"
    if scan.pin_error[k] <= PIN_ODD:
        return Finding("pins", "ok", said)
    return Finding(
        "pins",
        "error" if scan.pin_error[k] > PIN_WRONG else "warning",
        f"pins are {said.replace('at most ', 'up to ')}",
        f"{_at(clip, int(scan.sampled[k]))}, vertex {int(scan.pin[k])}",
        "garment and motion are of different clips, or the pins' weights are others than the simulation's",
    )
