"""Checks on clips together: one scene, both splits, no clip twice, nothing of the test set in training."""

import hashlib
from itertools import combinations
from typing import NamedTuple

import numpy as np

from garment_jax.importers.finding import Finding
from garment_jax.structs import Scene
from garment_jax.validation.raw_clip import RawClip

LEAK = 0.05  # of a test clip's frames that training clips show too
_SAME = 1e-4  # metres
_SPLITS = ("train", "test")


class ClipFacts(NamedTuple):
    """What one clip is compared by."""

    name: str
    split: str  # attribute `split`, or the name of the folder; "" for neither
    scene: Scene
    poses: list[bytes]  # a digest of the joints' rotations per frame
    cloth: bytes  # a digest of a few frames of vertices, empty without


def clip_facts(clip: RawClip) -> ClipFacts:
    """Return what an open clip is compared by; root positions do not count, a moved copy is a copy."""
    split = str(clip.attributes.get("split", ""))
    folder = clip.path.resolve().parent.name
    poses = [
        hashlib.blake2b(np.ascontiguousarray(R).tobytes(), digest_size=8).digest()
        for R in clip.motion.rotations
    ]
    cloth = hashlib.blake2b(digest_size=8)
    for frame in range(0, clip.frames, max(clip.frames // 4, 1)) if clip.moves_cloth else ():
        relative = clip.read(frame, frame + 1)[0] - clip.motion.root[frame].astype(np.float32)
        cloth.update(np.rint(np.nan_to_num(relative) * 1e3).astype("<i4").tobytes())
    return ClipFacts(
        str(clip.path),
        split if split in _SPLITS else folder if folder in _SPLITS else "",
        clip.scene,
        poses,
        cloth.digest() if clip.moves_cloth else b"",
    )


def check_set(clips: list[ClipFacts]) -> list[Finding]:
    """Return the findings on several clips together."""
    return [_scenes(clips), _splits(clips), *_duplicates(clips), *_leaks(clips)]


def same_scene(a: Scene, b: Scene) -> bool:
    """Return whether two scenes are one but for rounding (0.1 mm), as those of repaired clips are."""
    pairs = [(getattr(a.garment, name), getattr(b.garment, name)) for name in a.garment._fields]
    pairs += [(getattr(a.body, name), getattr(b.body, name)) for name in ("vertices", "faces", "joints")]
    return all(x.shape == y.shape and bool(np.allclose(x, y, rtol=0, atol=_SAME)) for x, y in pairs)


def _scenes(clips: list[ClipFacts]) -> Finding:
    groups: list[list[ClipFacts]] = []
    for clip in clips:
        group = next((known for known in groups if same_scene(known[0].scene, clip.scene)), None)
        if group is None:
            groups.append([clip])
        else:
            group.append(clip)
    if len(groups) == 1:
        return Finding("same scene", "ok", f"{len(clips)} clips of one garment and body")
    odd = min(groups, key=len)
    return Finding(
        "same scene",
        "warning",
        f"{len(clips)} clips show {len(groups)} different garments or bodies",
        odd[0].name,
        "a model is trained on one: keep them in folders of their own",
    )


def _splits(clips: list[ClipFacts]) -> Finding:
    counts = {split: sum(clip.split == split for clip in clips) for split in _SPLITS}
    if all(counts.values()) or not any(counts.values()):
        return Finding("splits", "ok", f"{counts['train']} to train, {counts['test']} to test")
    missing = "test" if counts["train"] else "train"
    return Finding(
        "splits", "note", f"there are no clips to {missing}", remedy=f"put some aside in a folder {missing}/"
    )


def _duplicates(clips: list[ClipFacts]) -> list[Finding]:
    found = []
    for a, b in combinations(clips, 2):
        if a.poses != b.poses:
            continue
        same = a.cloth == b.cloth
        found.append(
            Finding(
                "duplicate clips" if same else "same motion",
                "warning" if same else "note",
                "two clips are the same" if same else "two clips show the same motion with other cloth",
                f"{a.name} and {b.name}",
                "leave one out: it counts twice",
            )
        )
    return found or [Finding("duplicate clips", "ok", "none")]


def _leaks(clips: list[ClipFacts]) -> list[Finding]:
    found = []
    for test in (clip for clip in clips if clip.split == "test"):
        shares = {
            clip.name: len(set(test.poses) & set(clip.poses)) / len(set(test.poses))
            for clip in clips
            if clip.split == "train"
        }
        name = max(shares, key=lambda key: shares[key], default="")
        if shares and shares[name] > LEAK:
            found.append(
                Finding(
                    "leakage",
                    "warning",
                    f"{100 * shares[name]:.0f} % of a test clip's frames are in training",
                    f"{test.name} and {name}",
                    "take the motion out of one of them: the test would mean nothing",
                )
            )
    return found or [Finding("leakage", "ok", "no test frame is in training")]
