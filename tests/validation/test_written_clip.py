"""What `validate` calls an error is refused by `import`: nothing is written, a sentence says what helps."""

from pathlib import Path

import numpy as np
import pytest

from garment_jax.cli import main
from garment_jax.io.sequence_writer import SequenceWriter
from garment_jax.validation.written_clip import refuse_errors
from tests.reference.scene import make_motion, make_scene, make_vertices

FRAMES = 12
SCENE = make_scene()
MOTION = make_motion(SCENE, FRAMES)
V = make_vertices(SCENE, MOTION)


def written(path: Path, vertices: np.ndarray, *, root: np.ndarray = MOTION.root) -> Path:
    motion = MOTION._replace(root=root)
    with SequenceWriter(path, SCENE, motion, encoding="float32") as writer:
        writer.append(vertices)
    return path


def test_good_clip_passes(tmp_path: Path) -> None:
    refuse_errors(written(tmp_path / "walk.h5", V), "walk.pc2")


def test_other_axis_of_the_frames_is_named(tmp_path: Path) -> None:
    lying = V[..., [0, 2, 1]] * np.array([1, -1, 1], np.float32)  # Z up, taken for Y up
    with pytest.raises(ValueError, match=r"^walk\.pc2: .*give --clip-up Z\.$"):
        refuse_errors(written(tmp_path / "z.h5", lying), "walk.pc2")
    turned = V[..., [0, 2, 1]] * np.array([1, 1, -1], np.float32)  # Y up, taken for Z up
    with pytest.raises(ValueError, match=r"^walk\.pc2: .*give --clip-up Y\.$"):
        refuse_errors(written(tmp_path / "y.h5", turned), "walk.pc2")


def test_other_unit_of_the_motion_is_named(tmp_path: Path) -> None:
    path = written(tmp_path / "walk.h5", V, root=100 * MOTION.root)
    with pytest.raises(ValueError, match=r"root is .*give the motion's unit with --motion-unit"):
        refuse_errors(path, "walk.pc2")
    with pytest.raises(ValueError, match="pack the clip again in metres, Y up"):
        refuse_errors(path, "walk.h5", packed=True)


def test_check_keeps_a_file_from_its_place(tmp_path: Path) -> None:
    path = written(tmp_path / "walk.h5", V)
    before = path.read_bytes()

    def refuse(made: Path) -> None:
        assert made != path
        raise ValueError(f"{made.name} is refused.")

    writer = SequenceWriter(path, SCENE, MOTION, encoding="float32", check=refuse)
    with pytest.raises(ValueError, match=r"walk\.h5 is refused"), writer:
        writer.append(V)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_pc2_of_another_axis_is_refused_and_taken_with_the_option(
    shared_cases: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case, out = shared_cases / "pc2_z_up_near_the_body", tmp_path / "out"
    words = ["import", str(case / "sway.pc2"), "--motion", str(case / "sway.npz"), "--motion-up", "Y"]
    words += ["--body", str(case / "smpl.npz"), "--garment", str(case / "skirt.obj"), "--fps", "30"]
    assert main([*words, "--out", str(out)]) == 2
    assert "sway.pc2: pins are up to 6.2e+02 mm" in (told := capsys.readouterr().err)
    assert told.strip().endswith("give --clip-up Z.")
    assert [path for path in out.rglob("*") if path.is_file()] == []
    assert main([*words, "--clip-up", "Z", "--out", str(out)]) == 0
    assert main(["validate", str(out)]) == 0
