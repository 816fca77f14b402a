"""The configuration: one frozen dataclass per TOML section, loading, overrides, validation.

A new key is a new field: types int, float, bool, str, Literal, tuples of them, and any
of those `| None` (spelt "none" in a file). Numbers may not be negative; those named in
`_POSITIVE` may not be zero either. A default makes a key optional in a file.
"""

import dataclasses
import difflib
import hashlib
import json
import math
import tomllib
import types
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

_LOWER_BODY = ("LowerBack", "Spine", "LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg")


@dataclass(frozen=True)
class DataConfig:
    dir: str = "data"  # folder of imported sequence files, with train/ and test/ inside
    validation: tuple[str, ...] = ()  # names of training clips kept back from training
    mirror: bool = True  # add the left-right mirrored clips (a symmetric garment and body)


@dataclass(frozen=True)
class BodyConfig:
    motion_joints: tuple[str, ...] = _LOWER_BODY  # joints the network sees; ["all"]: all but the root
    seeds: int = 64  # seed points on the body under the garment
    tau: float = 0.2  # metres; length scale of the softmax skinning weights (see docs/method.md)
    skin_iterations: int = 3  # fixed-point passes of the inverse skinning


@dataclass(frozen=True)
class UvConfig:
    size: int = 64  # texels along each side of a UV map


@dataclass(frozen=True)
class GenerativeConfig:
    channels: tuple[int, ...] = (24, 48, 96, 128)  # widths of the four stride-2 convolutions
    latent_dim: int = 128  # of Z
    part_dim: int = 64  # of z_s and of z_d
    rec_hidden: tuple[int, ...] = (256, 256)  # hidden widths of D_rec
    rec_rank: int = 96  # rank of D_rec's last layer; 0 leaves it whole, as in the paper
    decomposition: bool = True  # D_rec and D_dyn; false: one decoder of positions from all of Z
    instance_norm: bool = True
    map_statistics: bool = True  # give E_gen's dense layer the channel means and deviations
    skin_reach: float = 0.0  # metres; unposed by weights smoothed so far; 0: the root frame, as in the paper
    linear_skip: bool = True  # linear paths beside the networks, begun from principal components
    laplacian: Literal["uniform", "cotangent"] = "uniform"  # of the template, everywhere
    norm: Literal["cm2", "plain"] = "cm2"  # mean squared cm, or the paper's norm of the mesh
    input_noise: float = 0.0  # metres; noise on E_gen's input vertices while training
    lambda_laplacian: float = 3.5
    lambda_unposed: float = 0.1
    lambda_template: float = 0.05
    lambda_kl: float = 1e-3
    steps: int = 20_000
    batch: int = 56  # frames
    learning_rate: float = 1e-4
    weight_decay: float = 1e-3


@dataclass(frozen=True)
class MotionConfig:
    gru: int = 500  # width of the recurrent state
    dense: int = 256  # width of E_m's dense layer
    channels: tuple[int, ...] = (24, 48, 96, 128)  # widths of E_s
    state_dim: int = 128  # width of E_s' garment vector
    state_hidden: int = 256  # width of the hidden layer in E_s' pooled path
    dropout: float = 0.0  # part of the motion features hidden from a lane for a window
    motion_noise: float = 0.0  # deviations; noise on the normalised motion while training
    state_noise: float = 0.0  # metres; noise on the previous frame while training
    from_first: float = 0.4  # part of the lanes that begin at a clip's first frame
    true_starts: float = 0.3  # part of the lanes that begin from a true frame, the rest skinned
    grace: int = 25  # frames after a skinned start within a clip whose error counts less
    lane_windows: int = 8  # windows after which a lane begins anew
    norm: Literal["cm2", "plain"] = "cm2"
    previous_state: bool = True  # E_s on the map of the last frame; false is the ablation
    window: int = 50  # frames of truncated back-propagation
    lanes: int = 8  # clips trained side by side
    lambda_laplacian: float = 1.5
    lambda_latent: float = 0.5
    warm_up_steps: int = 1_500  # windows in the linearised latent space before the full loop; 0 none
    warm_up_lanes: int = 32
    warm_up_rate: float = 1e-3
    steps: int = 5_000  # windows
    learning_rate: float = 1e-4
    weight_decay: float = 1e-3


@dataclass(frozen=True)
class DetailConfig:
    features: tuple[int, ...] = (8, 10)  # widths of the EdgeConv layers
    code_features: tuple[int, ...] = (64, 32)  # widths of the dense layers on Z
    hidden: int = 32  # width of a layer in which both meet; 0 leaves it out, as in the paper
    vertex_code: int = 8  # width of a learned vector for each vertex; 0 is the paper's
    channels: tuple[int, ...] = (16, 32, 64, 96)  # widths of the discriminator's convolutions
    source: Literal["reconstruction", "rollout"] = "reconstruction"  # the frames it learns from
    wrinkle_map: bool = True  # the discriminator sees the Laplacian too; false is the paper's
    lambda_laplacian: float = 1.0
    lambda_folds: float = 0.0  # of the depth of folds, by wavelength, beside L1 in cm; 0 is the paper's
    lambda_adversarial: float = 0.01  # of the generator's score term beside L1 in cm; 0: no discriminator
    steps: int = 3_000
    batch: int = 8  # frames
    learning_rate: float = 2e-4
    weight_decay: float = 1e-3


@dataclass(frozen=True)
class SwingConfig:
    """The swing: a recurrent network on a ring of columns, which corrects the codes (not in the paper)."""

    steps: int = 0  # windows; 0 leaves the stage out
    columns: int = 28  # sectors around the garment
    rows: int = 8  # cells from the pins to the hem
    hidden: int = 64  # width of each column's recurrent state
    width: int = 128  # of the layers between
    around: int = 5  # columns that a convolution sees, odd
    layers: int = 0  # further convolutions before the recurrence, and as many after it
    previous_state: bool = True  # the cells of the last frame are seen; false is the ablation
    dropout: float = 0.0  # part of the first layer hidden from a lane for a window
    motion_noise: float = 0.0  # on what a column sees of the motion (of scale 1), of a lane for a window
    noise: float = 0.01  # metres; noise on true starts while training
    window: int = 30  # frames of truncated back-propagation
    lanes: int = 32  # clips trained side by side
    from_first: float = 0.5  # part of the lanes that begin at a clip's first frame, the rest at a true one
    lane_windows: int = 25  # windows after which a lane begins anew
    learning_rate: float = 2e-3
    weight_decay: float = 1e-3


@dataclass(frozen=True)
class CollisionConfig:
    eps: float = 4e-3  # metres kept from the body; at 1 mm knees show through between the vertices
    iterations: int = 20  # projected-gradient steps at most
    tolerance: float = 5e-4  # metres; movement between two searches that counts as standing still
    limbs: bool = True  # put back on its side what a limb has passed through


@dataclass(frozen=True)
class BaselinesConfig:
    """The systems that ours is compared with (`garment_jax.baselines`); nothing here changes ours."""

    inputs: Literal["own", "ours"] = "own"  # motion that the networks see: their papers', or all of ours
    lanes: int = 32  # clips trained side by side
    components: int = 96  # principal components that the ridge regression predicts
    ridge: float = 100.0  # its penalty, on motion and coefficients in deviations
    santesteban_gru: int = 1_500  # width of the recurrent state
    santesteban_steps: int = 350  # windows
    santesteban_rate: float = 1e-3  # learning rate
    bones: int = 80  # virtual bones
    pan_gru: int = 500  # width of the recurrent state that moves the bones
    pan_steps: int = 1_200  # windows of the low-frequency part
    pan_rate: float = 1e-3
    pan_residual_gru: int = 128  # width of the recurrent state of the high-frequency part
    pan_residual_steps: int = 600  # batches of it
    pan_residual_rate: float = 5e-4
    decoder_steps: int = 450  # batches of the auto-encoder with one vertex decoder
    decoder_rate: float = 3e-4


@dataclass(frozen=True)
class TrainingConfig:
    seed: int = 0
    begin_from: str = ""  # folder of a saved model that stages 1 to 3 go on from; "": fresh parameters
    optimiser: Literal["adamw", "adam_l2"] = "adamw"  # adam_l2: decay added to the gradient
    clip_norm: float = 1.0  # largest global gradient norm; 0 switches clipping off
    schedule: Literal["constant", "cosine"] = "cosine"
    warmup: float = 0.02  # part of the steps in which the rate rises from 0
    final_rate: float = 0.01  # cosine: last rate as a part of the first
    log_every: int = 20  # steps
    checkpoint_seconds: float = 60.0
    validate_every: int = 1_000  # steps; 0 never


@dataclass(frozen=True)
class RolloutConfig:
    chunk: int = 256  # frames per compiled piece
    lengths: bool = True  # bring edges back to their lengths: blurred folds come back
    swing: float = 0.6  # part of the way from the codes to the swing that the cloth goes
    gain: float = 1.0  # of what the corrected cloth swings out: a mean of all it may do swings too little
    reach: float = (
        1.0  # of a cell's scale (8 cm at the shared skirt's hem): the most that is gone to the swing
    )


@dataclass(frozen=True)
class Config:
    data: DataConfig = field(default_factory=DataConfig)
    body: BodyConfig = field(default_factory=BodyConfig)
    uv: UvConfig = field(default_factory=UvConfig)
    generative: GenerativeConfig = field(default_factory=GenerativeConfig)
    motion: MotionConfig = field(default_factory=MotionConfig)
    detail: DetailConfig = field(default_factory=DetailConfig)
    swing: SwingConfig = field(default_factory=SwingConfig)
    collision: CollisionConfig = field(default_factory=CollisionConfig)
    baselines: BaselinesConfig = field(default_factory=BaselinesConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)
    rollout: RolloutConfig = field(default_factory=RolloutConfig)


_POSITIVE = frozenset(
    {"seeds", "tau", "skin_iterations", "size", "channels", "latent_dim", "part_dim", "rec_hidden"}
    | {"batch", "gru", "window", "lanes", "lane_windows", "features", "code_features", "learning_rate", "eps"}
    | {"rows", "columns", "width", "around", "log_every", "chunk", "gain", "reach", "components", "bones"}
)
_LARGEST = 2**31 - 1  # of whole numbers but seeds: steps are counted in 32 bits
_LARGEST_SEED = 2**62
_LONGEST = 10**300  # what a float holds, and more than anything means
_PARTS = frozenset({"dropout", "from_first", "true_starts", "swing", "warmup", "final_rate"})
# These say how a run is watched or used, not what it learns: a resumed run may change them. (A baseline's
# folder keeps its section among its facts.)
_RESULT_FREE = ("training.log_every", "training.checkpoint_seconds", "collision.", "rollout.", "baselines.")


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """Read a TOML file, then apply overrides `--SECTION.KEY VALUE` (or `--SECTION.KEY=VALUE`).

    Tuples are comma-separated in an override. ValueError names an unknown key (with the known
    ones), a wrong type, a value out of range or a file that is not TOML; FileNotFoundError a
    missing file.
    """
    if not Path(path).is_file():
        raise FileNotFoundError(f"No configuration file {str(path)!r}; the examples are in configs/.")
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # ValueError: a number of thousands of digits, too
        raise ValueError(f"{path} is not valid TOML: {error}; correct that line.") from error
    return apply_overrides(from_dict(table, source=str(path)), overrides)


def from_dict(table: Mapping[str, Any], *, source: str = "the configuration") -> Config:
    """Build a checked Config from nested dicts as TOML or JSON give them (inverse of `to_dict`)."""
    sections = get_type_hints(Config)
    table = _without_dynamics(table, source)
    _refuse_unknown(table, sections, kind="section", source=source)
    built = {}
    for name, entries in table.items():
        if not isinstance(entries, Mapping):
            raise ValueError(
                f"{source}: {name} = {entries!r} is a section; write [{name}] with keys under it."
            )
        hints = get_type_hints(sections[name])
        _refuse_unknown(entries, hints, kind=f"key in [{name}]", source=source)
        values = {key: _checked(f"{name}.{key}", hints[key], value, source) for key, value in entries.items()}
        built[name] = sections[name](**values)
    return _fitting(Config(**built), source)


def apply_overrides(config: Config, overrides: Sequence[str]) -> Config:
    """A copy of `config` with the command line's `--SECTION.KEY VALUE` pairs put in; ValueError as above."""
    source, sections, words = "command line", get_type_hints(Config), list(overrides)
    while words:
        option = words.pop(0)
        name, equals, text = option.removeprefix("--").partition("=")
        section, dot, key = name.partition(".")
        if not option.startswith("--") or not dot:
            raise ValueError(f"{source}: {option!r} is not an override; write --SECTION.KEY VALUE.")
        if not equals and not words:
            raise ValueError(f"{source}: {option} has no value; write {option} VALUE.")
        _refuse_unknown([section], sections, kind="section", source=source)
        hints = get_type_hints(sections[section])
        _refuse_unknown([key], hints, kind=f"key in [{section}]", source=source)
        text = text if equals else words.pop(0)
        value = _checked(name, hints[key], _parse(hints[key], text), source)
        config = dataclasses.replace(
            config, **{section: dataclasses.replace(getattr(config, section), **{key: value})}
        )
    return _fitting(config, source)


def _fitting(config: Config, source: str) -> Config:
    """`config`, or ValueError where UV maps cannot be halved by every convolution or the ring is no ring."""
    swing = config.swing
    if swing.around % 2 == 0 or swing.columns < swing.around or swing.hidden < 1 or swing.window < 2:
        raise ValueError(
            f"{source}: swing.around = {swing.around}, swing.columns = {swing.columns}, swing.hidden = "
            f"{swing.hidden}, swing.window = {swing.window}: give an odd number around, no more than there "
            "are columns, one hidden number and two frames at least."
        )
    size = config.uv.size
    for section in ("generative", "motion"):
        widths = getattr(config, section).channels
        if not widths:
            raise ValueError(f"{source}: {section}.channels is empty; give a width for each convolution.")
        if size % 2 ** len(widths):
            raise ValueError(
                f"{source}: uv.size = {size} cannot be halved by each of {len(widths)} convolutions "
                f"({section}.channels); give a multiple of {2 ** len(widths)}, such as 64."
            )
    return config


def to_dict(config: Config) -> dict[str, dict[str, Any]]:
    """Nested dicts of JSON and TOML types: tuples become lists, None becomes "none"."""
    return json.loads(json.dumps(dataclasses.asdict(config)), object_hook=_spell_none)


def to_toml(config: Config) -> str:
    """The whole configuration as TOML; `tomllib.loads` then `from_dict` gives an equal one."""
    blocks = []
    for name, entries in to_dict(config).items():
        # JSON's numbers, strings, booleans and lists are TOML's (finite numbers and whole characters only,
        # checked on entry), but for one control character that JSON leaves as it is.
        written = {key: json.dumps(value, ensure_ascii=False) for key, value in entries.items()}
        lines = [f"{key} = {value}".replace("\x7f", "\\u007f") for key, value in written.items()]
        blocks.append("\n".join([f"[{name}]", *lines]))
    return "\n\n".join(blocks) + "\n"


def content_hash(config: Config) -> str:
    """The first 16 hex digits of the SHA-256 over all values, independent of key order.

    What came later (baselines, decomposition, skin_reach, swing and its layers, previous_state, dropout and
    motion_noise, lengths, gain, reach, begin_from) counts where it differs from the defaults, so that older
    hashes hold.
    """
    values = to_dict(config)
    if config.baselines == BaselinesConfig():
        del values["baselines"]
    if config.swing == SwingConfig():
        del values["swing"]
    for key in ("layers", "previous_state", "dropout", "motion_noise") if "swing" in values else ():
        if getattr(config.swing, key) == getattr(SwingConfig(), key):
            del values["swing"][key]
    for key in ("decomposition", "skin_reach"):
        if getattr(config.generative, key) == getattr(GenerativeConfig(), key):
            del values["generative"][key]
    for key in ("lengths", "swing", "gain", "reach"):
        if getattr(config.rollout, key) == getattr(RolloutConfig(), key):
            del values["rollout"][key]
    if not config.training.begin_from:
        del values["training"]["begin_from"]
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """(SECTION.KEY, old value, new value) of two `to_dict` results that would change what is learnt."""
    keys = [(s, k) for s in {**old, **new} for k in {**old.get(s, {}), **new.get(s, {})}]
    pairs = [(f"{s}.{k}", old.get(s, {}).get(k), new.get(s, {}).get(k)) for s, k in keys]
    free = _RESULT_FREE
    if not old.get("swing", {}).get("steps"):
        free += ("swing.",)  # a stage that was off may be added: the others do not read it
    return [(name, a, b) for name, a, b in pairs if a != b and not name.startswith(free)]


def _without_dynamics(table: Mapping[str, Any], source: str) -> Mapping[str, Any]:
    """Return `table` without the section of the local dynamics, which older models name."""
    old = table.get("dynamics")
    if isinstance(old, Mapping) and old.get("steps", 0):
        raise ValueError(
            f"{source}: [dynamics] has steps = {old['steps']}, and local dynamics are no more; the "
            "swing takes their place: give [swing] steps (configs/skirt.toml), and train again."
        )
    return {name: entries for name, entries in table.items() if name != "dynamics"}


def _spell_none(entries: dict[str, Any]) -> dict[str, Any]:
    return {key: "none" if value is None else value for key, value in entries.items()}


def _refuse_unknown(names: Any, known: Mapping[str, Any], *, kind: str, source: str) -> None:
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"{source}: unknown {kind} {name!r}; known are {', '.join(known)}.{hint}")


def _is_union(hint: Any) -> bool:
    return get_origin(hint) in (Union, types.UnionType)


def _parse(hint: Any, text: str) -> Any:
    """The TOML value that a command-line word stands for, given the key's type."""
    if _is_union(hint):
        return None if text == "none" else _parse(_inner(hint), text)
    if get_origin(hint) is tuple:
        return [_parse(get_args(hint)[0], part.strip()) for part in text.split(",") if part.strip()]
    if hint is str or get_origin(hint) is Literal:
        return text
    try:
        return {"true": True, "false": False}[text] if hint is bool else hint(text)
    except (KeyError, ValueError):
        return text  # of the wrong type; _checked says so


def _inner(hint: Any) -> Any:
    return next(arg for arg in get_args(hint) if arg is not type(None))


def _checked(name: str, hint: Any, value: Any, source: str) -> Any:
    """`value` as the field's type (lists to tuples, integers to floats), or ValueError."""
    if type(value) is int and abs(value) > _LARGEST_SEED:  # no float may hold it, nor Python print it
        raise ValueError(f"{source}: {name} is a number of {value.bit_length()} bits; give a smaller one.")
    if _is_union(hint):
        return None if value in (None, "none") else _checked(name, _inner(hint), value, source)
    if get_origin(hint) is tuple:
        if not isinstance(value, list | tuple):
            raise ValueError(f"{source}: {name} = {value!r} must be a list; write [{value!r}].")
        return tuple(_checked(name, get_args(hint)[0], item, source) for item in value)
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            choices = ", ".join(map(repr, get_args(hint)))
            raise ValueError(f"{source}: {name} = {value!r} is not one of {choices}.")
        return value
    if hint is float and type(value) is int:
        if abs(value) > _LONGEST:
            raise ValueError(f"{source}: {name} is a number of {len(str(value))} digits; give a shorter one.")
        value = float(value)
    if type(value) is not hint:
        kind = {int: "a whole number", float: "a number", bool: "true or false", str: "a string"}[hint]
        raise ValueError(f"{source}: {name} = {value!r} must be {kind}.")
    if isinstance(value, str):
        if not _is_text(value):
            raise ValueError(
                f"{source}: {name} = {value!r} holds bytes that are no UTF-8; rename what it names."
            )
        return value
    return _in_range(name, value, source) if hint in (int, float) else value


def _is_text(value: str) -> bool:
    """Return whether a string can be written down: bytes of the command line that are no UTF-8 cannot."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def _in_range(name: str, value: float, source: str) -> float:
    key = name.partition(".")[2]
    positive = key in _POSITIVE
    largest = _LARGEST if key != "seed" else _LARGEST_SEED
    if isinstance(value, int) and abs(value) > largest:
        raise ValueError(f"{source}: {name} = {value} is out of range; give {largest} at most.")
    if key in _PARTS and not 0 <= value <= 1:
        raise ValueError(f"{source}: {name} = {value!r} is a part of a whole; give a number from 0 to 1.")
    if not math.isfinite(value) or value < 0 or (positive and value == 0):
        bound = "greater than 0" if positive else "0 or greater"
        raise ValueError(f"{source}: {name} = {value!r} must be a finite number, {bound}.")
    return value
