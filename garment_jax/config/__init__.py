"""The configuration: sections and keys, TOML and overrides, and which configurations are one."""

from garment_jax.config.former_names import current, current_names, former, former_names
from garment_jax.config.identity import content_hash, differences, network_keys
from garment_jax.config.reading import apply_overrides, from_dict, load_config, to_dict, to_toml
from garment_jax.config.sections import (
    BaselinesConfig,
    BodyConfig,
    CollisionConfig,
    ColumnRnnConfig,
    Config,
    DataConfig,
    DetailConfig,
    GenerativeConfig,
    MotionConfig,
    RolloutConfig,
    SimulationConfig,
    TrainingConfig,
    UvConfig,
)

__all__ = [
    "BaselinesConfig",
    "BodyConfig",
    "CollisionConfig",
    "ColumnRnnConfig",
    "Config",
    "DataConfig",
    "DetailConfig",
    "GenerativeConfig",
    "MotionConfig",
    "RolloutConfig",
    "SimulationConfig",
    "TrainingConfig",
    "UvConfig",
    "apply_overrides",
    "content_hash",
    "current",
    "current_names",
    "differences",
    "former",
    "former_names",
    "from_dict",
    "load_config",
    "network_keys",
    "to_dict",
    "to_toml",
]
