"""One frame of a clip as a picture: the body, the garment on it, and a camera that frames both."""

from typing import NamedTuple

import numpy as np

from garment_jax.body.kinematics import joint_positions, pose_body
from garment_jax.body.root_frame import heading
from garment_jax.evaluation.camera import Camera, look_at, view_direction
from garment_jax.evaluation.pair import read_finite
from garment_jax.evaluation.shading import Solid, draw
from garment_jax.io.sequence import Sequence

HEADROOM = 0.05  # metres of body shown above the garment
MARGIN = 1.10
_SPREAD = 12  # frames of a film that are looked at anyway


class Framing(NamedTuple):
    """What every picture of a sheet or film shows, so that they can be compared."""

    floor: float  # height of the lowest body point, metres
    middle: float  # height of the picture's centre, metres
    span: float  # metres from the picture's bottom to its top
    height: int  # pixels
    width: int  # pixels
    azimuth: float  # degrees from the body's front
    fixed_yaw: float | None  # the heading the camera stays at; None follows the body's


def frame_clips(
    bodies: np.ndarray,
    garments: list[np.ndarray],
    root: np.ndarray,
    yaw: np.ndarray,
    *,
    height: int,
    azimuth: float = 35.0,
    follow: bool = True,
    whole_body: bool = False,
) -> Framing:
    """Return the framing that holds the given frames.

    `bodies` `[k, b, 3]`, each of `garments` `[k, n, 3]`, `root` `[k, 3]` in world metres, `yaw` `[k]`
    radians. Without `whole_body` the picture ends a hand above the garment: the cloth is the subject.
    The camera turns with the body's heading when `follow`, else it keeps that of the first frame.
    """
    floor = float(bodies[..., 1].min())
    top = bodies[..., 1].max() if whole_body else max(g[..., 1].max() for g in garments) + HEADROOM
    low, high = floor - 0.05, float(top)
    widest = 0.0
    for k in range(len(root)):
        facing = yaw[k] if follow else yaw[0]
        right = np.cross([0.0, 1.0, 0.0], view_direction(facing, azimuth=azimuth))
        top_shown = high if whole_body else root[k, 1]  # arms may leave the picture, legs may not
        legs = bodies[k][bodies[k][:, 1] < top_shown]
        for points in (legs, *(g[k] for g in garments)):
            widest = max(widest, float(np.abs((points - root[k]) @ right).max(initial=0.0)))
    aspect = float(np.clip(2 * widest / (high - low), 0.55, 1.15))
    span = max(high - low, 2 * widest / aspect) * MARGIN
    width = 2 * round(height * aspect / 2)
    return Framing(floor, (low + high) / 2, span, height, width, azimuth, None if follow else float(yaw[0]))


def outermost_frames(clips: list[Sequence], shown: np.ndarray, *, azimuth: float) -> np.ndarray:
    """Return those of frames `shown` `[k]` that decide what a camera that keeps its direction has to hold.

    Twelve spread over them and those in which a joint or the garments reach farthest to a side, up or down:
    the body itself is posed in these alone. They begin with the first. Raises `ValueError` for a frame that
    is not finite.
    """
    motion, body = clips[-1].motion, clips[-1].scene.body
    rotations, root = motion.rotations[shown], motion.root[shown]
    right = np.cross([0.0, 1.0, 0.0], view_direction(float(heading(rotations[:1, 0])[0]), azimuth=azimuth))
    joints = joint_positions(rotations, root, body)
    aside = np.abs((joints - root[:, None]) @ right)
    legs = np.where(joints[..., 1] < root[:, None, 1], aside, 0.0)
    reaches = [aside.max(axis=1), legs.max(axis=1), joints[..., 1].max(axis=1), -joints[..., 1].min(axis=1)]
    for clip in clips:
        cloth = np.zeros((len(shown), 2))
        for k, frame in enumerate(shown):
            V = read_finite(clip, int(frame), int(frame) + 1)[0]
            cloth[k] = np.abs((V - root[k]) @ right).max(), V[:, 1].max()
        reaches += list(cloth.T)
    farthest = shown[[int(reach.argmax()) for reach in reaches]]
    return np.union1d(shown[:: max(len(shown) // _SPREAD, 1)], farthest)


def camera_at(framing: Framing, root: np.ndarray, yaw: float, *, supersampling: int) -> Camera:
    """Return the camera for a frame with this `root` `[3]` and heading."""
    facing = yaw if framing.fixed_yaw is None else framing.fixed_yaw
    return look_at(
        np.array([root[0], framing.middle, root[2]]),
        view_direction(facing, azimuth=framing.azimuth),
        span=framing.span,
        height=framing.height * supersampling,
        width=framing.width * supersampling,
    )


def picture(
    body: np.ndarray,
    body_faces: np.ndarray,
    body_ink: np.ndarray,
    garment: np.ndarray,
    faces: np.ndarray,
    colours: np.ndarray,
    camera: Camera,
    *,
    lit: float = 1.0,
    floor: float,
    supersampling: int = 2,
) -> np.ndarray:
    """Return an RGB picture `[h, w, 3]` uint8 of a dressed body.

    `body` `[b, 3]`, `garment` `[n, 3]` world metres; `body_ink` `[b, 3]` sRGB (`colours.body_colours`),
    `colours` `[n, 3]` sRGB of the garment, or `[3]`; `lit` below 1 keeps a heat map's colours readable.
    Drawn at the camera's size and averaged down by `supersampling`.
    """
    ink = np.broadcast_to(colours, garment.shape)
    solid = Solid(
        np.concatenate([body, garment]).astype(np.float64),
        np.concatenate([body_faces, faces + len(body)]),
        np.concatenate([body_ink, ink]),
        np.concatenate([np.ones(len(body)), np.full(len(garment), lit)]),
    )
    large = draw(solid, camera, floor=floor)
    h, w, s = camera.height // supersampling, camera.width // supersampling, supersampling
    return (255 * large.reshape(h, s, w, s, 3).mean(axis=(1, 3)) + 0.5).astype(np.uint8)


def read_frames(clip: Sequence, frames: np.ndarray) -> np.ndarray:
    """Return the garment at `frames` `[k]`, `[k, n, 3]` world metres, finite; one frame read at a time."""
    return np.concatenate([read_finite(clip, int(f), int(f) + 1) for f in frames])


def body_at(clip: Sequence, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the posed body `[k, b, 3]`, root `[k, 3]` and heading `[k]` at `frames`."""
    body = pose_body(clip.scene.body, clip.motion, frames)
    return body, clip.motion.root[frames], heading(clip.motion.rotations[frames, 0])
