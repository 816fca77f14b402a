# ruff: noqa: RUF009 (`key` and `section` return `dataclasses.field`s)
"""The configuration: one frozen dataclass per TOML section, one line per key.

A key is `NAME: TYPE = key(DEFAULT, HELP, CHECK, shapes=...)`. Types are int, float, bool, str, Literal,
tuples of them, and any of those `| None` (spelt "none" in a file). Every key is optional in a file.
"""

from dataclasses import dataclass
from typing import Literal

from garment_jax.config.key import key, section

_LOWER_BODY = ("LowerBack", "Spine", "LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg")


@dataclass(frozen=True)
class DataConfig:
    dir: str = key("data", "folder of sequence files, with train/ and test/ inside")
    validation: tuple[str, ...] = key((), "training clips kept for validation")
    mirror: bool = key(True, "add mirrored clips (for a symmetric garment and body)")


@dataclass(frozen=True)
class BodyConfig:
    motion_joints: tuple[str, ...] = key(
        _LOWER_BODY, 'joints that the networks see; ["all"]: all but the root', shapes="network"
    )
    seeds: int = key(64, "seed points on the body", "positive")
    tau: float = key(0.2, "metres; length scale of the softmax skinning weights", "positive")
    skin_iterations: int = key(3, "fixed-point iterations of the inverse skinning", "positive")


@dataclass(frozen=True)
class UvConfig:
    size: int = key(64, "texels along each side of a UV map", "positive", shapes="network")


@dataclass(frozen=True)
class GenerativeConfig:
    channels: tuple[int, ...] = key(
        (24, 48, 96, 128), "widths of the stride-2 convolutions", "positive", shapes="network"
    )
    latent_dim: int = key(128, "width of Z", "positive", shapes="network")
    part_dim: int = key(64, "width of z_s and of z_d", "positive", shapes="network")
    rec_hidden: tuple[int, ...] = key((256, 256), "hidden widths of D_rec", "positive", shapes="network")
    rec_rank: int = key(96, "rank of D_rec's last layer; 0: full, the paper's", shapes="network")
    decomposition: bool = key(True, "D_rec and D_dyn; false: one decoder", shapes="network", later=True)
    instance_norm: bool = key(True, "normalise each channel in the encoder", shapes="network")
    map_statistics: bool = key(
        True, "give E_gen's dense layer the channel means and deviations", shapes="network"
    )
    skin_reach: float = key(
        0.0,
        "metres; smoothing of the weights that remove the pose; 0: the paper's root frame",
        shapes="network",
        later=True,
    )
    linear_skip: bool = key(
        True, "linear paths beside the networks, from principal components", shapes="network"
    )
    laplacian: Literal["uniform", "cotangent"] = key("uniform", "weights of the template's Laplacian")
    norm: Literal["cm2", "plain"] = key("cm2", "mean squared cm or the paper's norm")
    input_noise: float = key(0.0, "metres; noise on E_gen's input")
    lambda_laplacian: float = key(3.5, "weight of the Laplacian loss")
    lambda_unposed: float = key(0.1, "weight of the unposed loss")
    lambda_template: float = key(0.05, "weight of the unposed distance from the template")
    lambda_kl: float = key(1e-3, "weight of the KL term")
    steps: int = key(20_000, "batches")
    batch: int = key(56, "frames", "positive")
    learning_rate: float = key(1e-4, "first rate", "positive")
    weight_decay: float = key(1e-3, "of the optimiser")


@dataclass(frozen=True)
class MotionConfig:
    gru: int = key(500, "width of the GRU", "positive", shapes="network")
    dense: int = key(256, "width of E_m's dense layer", shapes="network")
    channels: tuple[int, ...] = key((24, 48, 96, 128), "widths of E_s", "positive", shapes="network")
    state_dim: int = key(128, "width of E_s' garment vector", shapes="network")
    state_hidden: int = key(256, "hidden width of E_s' pooled path", shapes="network")
    dropout: float = key(0.0, "part of the motion features hidden for a window", "part")
    motion_noise: float = key(0.0, "deviations; noise on the motion")
    state_noise: float = key(0.0, "metres; noise on the previous frame")
    from_first: float = key(0.4, "part of the lanes that start at a clip's first frame", "part")
    true_starts: float = key(
        0.3, "part that starts from a true frame, the rest from the skinned template", "part"
    )
    grace: int = key(25, "frames after a skinned start whose error counts less")
    lane_windows: int = key(8, "windows until a lane starts anew", "positive")
    norm: Literal["cm2", "plain"] = key("cm2", "mean squared cm or the paper's norm")
    previous_state: bool = key(True, "E_s on the map of the last frame; false: ablation", shapes="network")
    window: int = key(50, "frames of truncated back-propagation", "positive")
    lanes: int = key(8, "clips trained side by side", "positive")
    lambda_laplacian: float = key(1.5, "weight of the Laplacian loss")
    lambda_latent: float = key(0.5, "weight of the loss on latents")
    warm_up_steps: int = key(1_500, "windows in the linearised latent space; 0: none")
    warm_up_lanes: int = key(32, "clips side by side in the warm-up")
    warm_up_rate: float = key(1e-3, "first learning rate of the warm-up")
    steps: int = key(5_000, "windows")
    learning_rate: float = key(1e-4, "first rate", "positive")
    weight_decay: float = key(1e-3, "of the optimiser")


@dataclass(frozen=True)
class DetailConfig:
    features: tuple[int, ...] = key((8, 10), "widths of the EdgeConv layers", "positive", shapes="network")
    code_features: tuple[int, ...] = key(
        (64, 32), "widths of the dense layers on Z", "positive", shapes="network"
    )
    hidden: int = key(32, "width of a layer in which both meet; 0: none, the paper's", shapes="network")
    vertex_code: int = key(8, "width of a learned vector per vertex; 0: the paper's", shapes="network")
    channels: tuple[int, ...] = key(
        (16, 32, 64, 96), "widths of the discriminator's convolutions", "positive"
    )
    source: Literal["reconstruction", "rollout"] = key("reconstruction", "the frames it learns from")
    wrinkle_map: bool = key(True, "the discriminator sees the Laplacian; false: the paper's")
    lambda_laplacian: float = key(1.0, "weight of the Laplacian loss")
    lambda_folds: float = key(0.0, "weight of the depth of folds by wavelength; 0: the paper's")
    lambda_adversarial: float = key(0.01, "weight of the adversarial loss; 0: no discriminator")
    steps: int = key(3_000, "batches")
    batch: int = key(8, "frames", "positive")
    learning_rate: float = key(2e-4, "first rate", "positive")
    weight_decay: float = key(1e-3, "of the optimiser")


@dataclass(frozen=True)
class ColumnRnnConfig:
    """A recurrent network on a ring of columns, which corrects the latents (not in the paper)."""

    steps: int = key(0, "windows; 0 leaves the stage out")
    columns: int = key(28, "sectors around the garment", "positive")
    rows: int = key(8, "cells from the pins to the hem", "positive", shapes="network")
    hidden: int = key(64, "width of each column's GRU", shapes="network")
    width: int = key(128, "width of the other layers", "positive", shapes="network")
    around: int = key(5, "columns that a convolution sees, odd", "positive", shapes="network")
    layers: int = key(0, "further convolutions before and after the GRU", shapes="network", later=True)
    previous_state: bool = key(
        True, "the last frame's cells as input; false: ablation", shapes="network", later=True
    )
    dropout: float = key(0.0, "part of the first layer hidden for a window", "part", later=True)
    motion_noise: float = key(0.0, "noise on the input (of scale 1)", later=True)
    noise: float = key(0.01, "metres; noise on true starts")
    window: int = key(30, "frames of truncated back-propagation", "positive")
    lanes: int = key(32, "clips trained side by side", "positive")
    from_first: float = key(
        0.5, "part of the lanes that start at a clip's first frame, the rest at a true one", "part"
    )
    lane_windows: int = key(25, "windows until a lane starts anew", "positive")
    learning_rate: float = key(2e-3, "first rate", "positive")
    weight_decay: float = key(1e-3, "of the optimiser")


_KINDS = (
    "crossed tempo=0.65:1.45 legs=0.75:1.35 turn=100 spins=0.7",
    "crossed tempo=0.65:1.45 legs=0.75:1.35 turn=100 spins=1.5",
    "crossed turn=100",
    "crossed turn=100 spins=0.7 kicks=4",
    "crossed tempo=0.65:1.45 legs=0.75:1.35 turn=60 kicks=2",
    "varied tempo=0.65:1.45 legs=0.75:1.35 turn=120 spins=0.7",
    "varied turn=60 kicks=2",
    "crossed tempo=0.65:1.45 legs=0.75:1.35 turn=40",
    "varied tempo=1 legs=1 turn=0 begin=0",  # as it was danced
    "varied turn=60",
    "crossed turn=60 kicks=2:6",
    "varied turn=60 spins=0.7 kicks=2:6",
)


@dataclass(frozen=True)
class SimulationConfig:
    """Clips that are simulated to learn from, beside the recorded ones."""

    clips: int = key(0, "motions drawn out of the recorded ones; 0: the recorded clips alone")
    kinds: tuple[str, ...] = key(_KINDS, "of motions, by turns: 'Making training clips'", later=True)
    longest: int = key(350, "frames of a motion, cut out anywhere", "positive")
    cloth: tuple[str, ...] = key((), 'as `simulate --cloth`, such as ["bend_bias=0.5"]')
    pattern: str = key("", 'as `simulate --pattern`; "": from the UVs')
    seed: int = key(0, "of the motions that are drawn", "seed", later=True)
    dir: str = key("", 'folder of the clips, which runs may share; "": in the run', shapes="use")
    device: str = key("cpu", "cuda: many clips side by side on a GPU", shapes="use")
    at_once: int = key(128, "clips side by side there", "positive", shapes="use")
    workers: int = key(1, "processes", "positive", shapes="use")


@dataclass(frozen=True)
class CollisionConfig:
    # at 1 mm knees show through between the vertices
    eps: float = key(4e-3, "metres; distance kept from the body", "positive")
    iterations: int = key(20, "projected-gradient steps at most")
    tolerance: float = key(5e-4, "metres; smaller movements count as none")
    limbs: bool = key(True, "undo limb crossings")
    untangle: bool = key(False, "undo crossings of the garment with itself", later=True)


@dataclass(frozen=True)
class BaselinesConfig:
    """The systems that ours is compared with (`garment_jax.baselines`); nothing here changes ours."""

    inputs: Literal["own", "ours"] = key("own", "motion features of their papers, or ours")
    lanes: int = key(32, "clips trained side by side", "positive")
    components: int = key(96, "principal components of the ridge", "positive")
    ridge: float = key(100.0, "the ridge's penalty")
    santesteban_gru: int = key(1_500, "width of the GRU")
    santesteban_steps: int = key(350, "windows")
    santesteban_rate: float = key(1e-3, "first rate")
    bones: int = key(80, "virtual bones", "positive")
    pan_gru: int = key(500, "width of the GRU")
    pan_steps: int = key(1_200, "windows of the low frequencies")
    pan_rate: float = key(1e-3, "its first rate")
    pan_residual_gru: int = key(128, "width of the GRU of the high frequencies")
    pan_residual_steps: int = key(600, "batches of the high frequencies")
    pan_residual_rate: float = key(5e-4, "its first rate")
    decoder_steps: int = key(450, "batches of the one-decoder auto-encoder")
    decoder_rate: float = key(3e-4, "its first rate")


@dataclass(frozen=True)
class TrainingConfig:
    seed: int = key(0, "of parameters, batches and noise", "seed")
    begin_from: str = key("", 'saved model to start from; "": fresh parameters', later=True)
    optimiser: Literal["adamw", "adam_l2"] = key("adamw", "adam_l2: decay added to the gradient")
    clip_norm: float = key(1.0, "largest global gradient norm; 0: no clipping")
    schedule: Literal["constant", "cosine"] = key("cosine", "of the learning rates")
    warmup: float = key(0.02, "part of the steps in which rates rise", "part")
    final_rate: float = key(0.01, "last rate ÷ first", "part")
    average: float = key(
        0.0,
        "last part of the steps that is averaged; 0: none",
        "part",
        later=True,
    )
    log_every: int = key(20, "steps between lines of the log", "positive", shapes="use")
    checkpoint_seconds: float = key(60.0, "between checkpoints", shapes="use")
    validate_every: int = key(1_000, "steps between validations; 0: never")


@dataclass(frozen=True)
class RolloutConfig:
    chunk: int = key(256, "frames per compiled piece", "positive")
    lengths: bool = key(True, "bring edges back to their lengths", later=True)
    column_rnn: float = key(
        0.6, "part of the column RNN's correction applied", "part", later=True, was="swing"
    )


@dataclass(frozen=True)
class Config:
    data: DataConfig = section(DataConfig, "the clips")
    body: BodyConfig = section(BodyConfig, "motion features and skinning")
    uv: UvConfig = section(UvConfig, "UV maps")
    generative: GenerativeConfig = section(GenerativeConfig, "stage 1, the paper's section 3.2")
    motion: MotionConfig = section(MotionConfig, "stage 2, section 3.3")
    detail: DetailConfig = section(DetailConfig, "stage 3, section 3.4")
    column_rnn: ColumnRnnConfig = section(
        ColumnRnnConfig, "stage 4, the column RNN (not in the paper)", later=True, was="swing"
    )
    simulation: SimulationConfig = section(SimulationConfig, "clips simulated to train on", later=True)
    collision: CollisionConfig = section(CollisionConfig, "section 3.5", shapes="use")
    # a baseline's folder keeps this section among its facts
    baselines: BaselinesConfig = section(BaselinesConfig, "the compared systems", shapes="use", later=True)
    training: TrainingConfig = section(TrainingConfig, "what all stages share")
    rollout: RolloutConfig = section(RolloutConfig, "how a trained model is rolled out", shapes="use")
