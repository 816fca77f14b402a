"""The parts of a scene as files that users have: body, garment, motion."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from garment_jax.structs import Garment, Motion, RiggedBody


def write_body(path: Path, body: RiggedBody) -> Path:
    """Write the arrays of a rigged body as `.npz`."""
    np.savez(path, **(body._asdict() | {"joint_names": np.array(body.joint_names)}))
    return path


def write_obj(path: Path, garment: Garment) -> Path:
    """Write a garment's template with its UVs as OBJ."""
    lines = [f"v {x} {y} {z}" for x, y, z in garment.template.tolist()]
    lines += [f"vt {u} {v}" for u, v in garment.uv.tolist()]
    pairs = np.stack([garment.faces, garment.faces_uv], axis=-1) + 1
    lines += ["f " + " ".join(f"{v}/{t}" for v, t in face) for face in pairs.tolist()]
    path.write_text("\n".join(lines))
    return path


def write_bvh(path: Path, body: RiggedBody, motion: Motion) -> Path:
    """Write a motion on the body's own skeleton, cm, with the channels ZXY."""
    x, lines, order = body.joints.astype(np.float64) * 100, [], []

    def joint(j: int) -> None:
        order.append(j)
        offset = x[j] - (x[body.parents[j]] if j else x[0])
        name = body.joint_names[j]
        lines.append(f"{'JOINT' if j else 'ROOT'} {name}\n{{\nOFFSET {' '.join(map(repr, offset.tolist()))}")
        lines.append(f"CHANNELS {3 if j else 6} {'' if j else 'Xposition Yposition Zposition '}")
        lines[-1] += "Zrotation Xrotation Yrotation"
        for child in np.flatnonzero(body.parents == j):
            joint(int(child))
        lines.append("}")

    joint(0)
    R = motion.rotations.astype(np.float64)
    values = [motion.root * 100]
    for j in order:
        parent = body.parents[j]
        local = R[:, j] if parent < 0 else np.swapaxes(R[:, parent], -1, -2) @ R[:, j]
        values.append(Rotation.from_matrix(local).as_euler("ZXY", degrees=True))
    rows = [" ".join(map(repr, row.tolist())) for row in np.concatenate(values, axis=1)]
    head = f"MOTION\nFrames: {len(rows)}\nFrame Time: {1 / motion.fps:.6f}"
    path.write_text("\n".join(["HIERARCHY", *lines, head, *rows]))
    return path
