"""What pyproject.toml cannot say: `models/` and `configs/` are installed inside `garment_jax`."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["garment_jax*"]), "garment_jax.models", "garment_jax.configs"],
    package_dir={"garment_jax.models": "models", "garment_jax.configs": "configs"},
)
