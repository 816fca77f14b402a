"""The kinds of files that are read: a good file of each, and the commands that read it."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.fuzz.command_lines import in_a_fork
from tests.importers.glb_files import glb_parts
from tests.importers.good_files import MOTION, SCENE, V, write_all, write_usd
from tests.io.formats.test_alembic import archive, sampling
from tests.io.packed import write_packed
from tests.reference.scene import write_clip

_OWN = "--garment skirt.obj --body me.npz"
_SMPL = "--garment skirt/skirt.obj --fit-uv --body smpl.pkl"
_CACHE = f"{_OWN} --motion walk.bvh --clip-unit m --clip-up Y --format meshes"
_BONES = "--format virtualbones --body smpl.pkl --fps 30 --clip-up Y --motion-up Y"
_EXPORT = "export clip.h5 --no-body --out out/clip"
_TRAIN = "train.py tiny.toml --data clips --run-dir run"


class Kind(NamedTuple):
    """A file that is damaged, and the commands that read it then; what they make lies in `out`."""

    name: str
    commands: tuple[str, ...]
    needs: str = ""  # "model": jax writes it; "programs": and compiles what the commands run


def _import(words: str) -> str:
    return f"import {words} --out out"


def _both(name: str, imported: str, *, shown: str = "") -> Kind:
    return Kind(name, (f"validate {shown or name}", _import(imported)))


KINDS = {
    "sequence": Kind("clip.h5", ("validate clip.h5", "info clip.h5")),
    "motion alone": Kind(
        "clip.h5", ("validate clip.h5", "info clip.h5", _import(f"clip.h5 {_OWN} --format motion"))
    ),
    "clip measured": Kind(
        "clip.h5",
        (
            "evaluate clip.h5 good.h5 --out out.json",
            "evaluate good.h5 clip.h5",
            "render clip.h5 --out out --frames 1 --height 40",
            "view clip.h5 good.h5 --out out/page.html",
        ),
    ),
    "clip exported": Kind(
        "clip.h5",
        tuple(f"{_EXPORT}.{end}" for end in ("npz", "pc2", "mdd", "glb")) + (f"{_EXPORT} --format obj",),
    ),
    "clip to usd": Kind("clip.h5", (f"{_EXPORT}.usda",)),
    "clip animated": Kind(
        "clip.h5",
        ("infer.py model --motion clip.h5 --out out/pred.h5", "collide clip.h5 --out out/solved.h5"),
        "programs",
    ),
    "packed clip": _both("packed/skirt/train_waltz.h5", "packed/skirt/train_waltz.h5"),
    "garment": _both("skirt.obj", f"walk.bvh {_OWN}"),
    "body .npz": _both("me.npz", f"walk.bvh {_OWN}"),
    "body .glb": _both("me.glb", "walk.bvh --garment skirt.obj --body me.glb"),
    "body .gltf": _both("me.gltf", "walk.bvh --garment skirt.obj --body me.gltf"),
    "buffer of a .gltf": _both("me.bin", "walk.bvh --garment skirt.obj --body me.gltf", shown="me.gltf"),
    "motion .gltf": Kind("me.gltf", (_import(f"me.gltf {_OWN}"),)),
    "buffer of a motion": Kind("me.bin", (_import(f"me.gltf {_OWN}"),)),
    "body .pkl": _both("smpl.pkl", f"amass.npz {_SMPL}"),
    "bvh": _both("walk.bvh", f"walk.bvh {_OWN}"),
    "amass": _both("amass.npz", f"amass.npz {_SMPL}"),
    "aist": _both("aist.pkl", f"aist.pkl {_SMPL}"),
    "joint table": Kind("joints.toml", (_import(f"walk.bvh {_OWN} --joints joints.toml"),)),
    "virtualbones": _both("dress02/1.npz", f"dress02 {_BONES}"),
    "vto": _both("skirt/simulations/walk.pkl", "skirt --format vto --body smpl.pkl"),
    "pc2": _both("walk.pc2", f"walk.pc2 {_CACHE} --fps 30"),
    "mdd": _both("walk.mdd", f"walk.mdd {_CACHE}"),
    "obj frames": _both("walk/walk_2.obj", f"walk {_CACHE} --fps 30", shown="walk"),
    "ply frames": _both("walk.ply/1.ply", f"walk.ply {_CACHE} --fps 30", shown="walk.ply"),
    "usda": _both("walk.usda", f"walk.usda {_CACHE}"),
    "usdc": _both("walk.usdc", f"walk.usdc {_CACHE}"),
    # without Blender (none here) only what the package itself reads of it: the samplings' times
    "alembic": _both("walk.abc", f"walk.abc {_CACHE}"),
    "configuration": Kind("run/config.toml", ("info run",)),
    "figures": Kind("run/figures.json", ("info run",)),
    "configuration to train": Kind("train.toml", ("train.py train.toml --data nowhere --run-dir out",)),
    "benchmark": Kind("bench.toml", ("benchmark bench.toml --data clips --out out --report-only",)),
    "model's config.toml": Kind("model/config.toml", ("info model", "save model --out out"), "model"),
    "model's model.json": Kind("model/model.json", ("info model", "save model --out out"), "model"),
    "model's parameters": Kind("model/parameters.npz", ("info model", "save model --out out"), "model"),
    "older model's config": Kind("older/config.toml", ("info older", "save older --out out"), "model"),
    "older model's parameters": Kind("older/parameters.npz", ("save older --out out",), "model"),
    "model's figures": Kind("model/figures.json", ("info model",), "model"),
    "model's variants": Kind(
        "model/variants.json",
        ("infer.py model --motion clip.h5 --lod 0.5 --out out/pred.h5",),
        "programs",
    ),
    "checkpoint's metadata": Kind(
        "trained/checkpoints/motion/8/metadata.json", ("save trained --out out",), "model"
    ),
    "metadata without digests": Kind(
        "early/checkpoints/motion/8/metadata.json", ("save early --out out",), "model"
    ),
    "arrays without digests": Kind(
        "early/checkpoints/motion/8/state/_METADATA", ("save early --out out",), "model"
    ),
    "checkpoint's digests": Kind(
        "trained/checkpoints/motion/8/digests.json", ("save trained --out out",), "model"
    ),
    "run's config.toml": Kind("trained/config.toml", ("info trained", "save trained --out out"), "model"),
    "run's facts": Kind("run/facts.json", (_TRAIN,), "model"),
    "run's own config": Kind("run/config.toml", (_TRAIN,), "model"),
}


def write_good(folder: Path, kind: str) -> None:
    """Write a good file of every kind that needs what `kind` does."""
    write_clip(folder / "clip.h5", 6)
    write_clip(folder / "good.h5", 6)
    if KINDS[kind].needs:
        in_a_fork(_write_models, folder)
        return
    write_all(folder)
    write_packed(folder / "packed")
    content, data = glb_parts(SCENE.body, MOTION)
    content["buffers"][0]["uri"] = "me.bin"
    (folder / "me.bin").write_bytes(data)
    (folder / "me.gltf").write_text(json.dumps(content))
    (folder / "walk.abc").write_bytes(archive(sampling(6, 1 / 30, 0.0)))
    table = [f'{name} = "{name}"' for name in SCENE.body.joint_names]
    (folder / "joints.toml").write_text("\n".join([*table, ""]))
    (folder / "run").mkdir()
    text = "[training]\nseed = 3\n[uv]\nsize = 64\n[motion]\nsteps = 100\nlearning_rate = 1e-4\n"
    (folder / "run/config.toml").write_text(text)
    (folder / "run/figures.json").write_text('{"rmse_cm": 3.5, "of": {"a": [1, 2, {"b": "c"}]}}')
    from garment_jax.config import Config, to_toml

    (folder / "train.toml").write_text(to_toml(Config()))
    (folder / "clips/train").mkdir(parents=True)
    (folder / "clips/test").mkdir()
    for name in ("train/a", "train/b", "test/c"):
        write_clip(folder / f"clips/{name}.h5", 6)
    configs = Path(__file__).parents[2] / "configs"
    (folder / "bench.toml").write_text((configs / "benchmark.toml").read_text())
    (folder / "skirt.toml").write_text((configs / "skirt.toml").read_text())
    write_usd(folder / "walk.usda", V)
    try:
        from pxr import Sdf  # its types are not known to the type checker

        layer = getattr(Sdf, "Layer").FindOrOpen(str(folder / "walk.usda"))  # noqa: B009
        layer.Export(str(folder / "walk.usdc"))
    except ImportError:
        (folder / "walk.usda").unlink()


def _write_models(folder: Path) -> None:
    """Write a saved model, one of an older version, a run, one without digests, and what a run is of."""
    from garment_jax.animation.variants import VARIANTS
    from garment_jax.config import to_dict, to_toml
    from garment_jax.io.content_hash import garment_hash
    from garment_jax.model.store import save_model
    from garment_jax.training.checkpoint import Checkpointer
    from garment_jax.training.run_directory import prepare_run
    from tests.animation.tiny_model import CONFIG, tiny_model
    from tests.animation.tiny_model import SCENE as scene

    model = tiny_model()
    for name in ("model", "older"):
        save_model(model, folder / name, bits=32)
    facts = json.loads((folder / "older/model.json").read_text())
    kept = {key: value for key, value in facts.items() if key not in ("shaping", "arrays")}
    (folder / "older/model.json").write_text(json.dumps(kept))
    (folder / "model/figures.json").write_text('{"rmse_cm": 3.5, "of": {"a": [1, 2, {"b": "c"}]}}')
    rows = [
        {"name": name, "settings": variant._asdict(), "ms": 2.0, "error_cm": 3.0}
        for name, variant in VARIANTS.items()
    ]
    (folder / "model/variants.json").write_text(json.dumps({"variants": rows, "detail_mm": 1.0}))
    described = {
        "config": to_dict(model.config),
        "garment_hash": model.garment_hash,
        "vertices": model.vertices,
        "fps": model.fps,
        "statistics": {k: np.asarray(v).tolist() for k, v in model.statistics._asdict().items()},
    }
    for name in ("trained", "early"):
        prepare_run(folder / name, CONFIG, facts={"garment": model.garment_hash})
        for stage in ("generative", "motion"):
            saved = Checkpointer(folder / name, stage, metadata=described)
            saved.save(8, {"params": model.params[stage]}, extra={"seconds": 1.0})
    for digests in (folder / "early").rglob("digests.json"):
        digests.unlink()
    (folder / "tiny.toml").write_text(to_toml(CONFIG))
    for k in (1, 2, 3):
        # shorter than a window: whatever the run's folder says, nothing is trained
        write_clip(folder / f"clips/train/waltz_{k}.h5", 4, k, scene=scene)
    prepare_run(folder / "run", CONFIG, facts={"garment": garment_hash(scene.garment), "data": "others"})
