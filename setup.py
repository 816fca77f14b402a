"""What pyproject.toml cannot say: `models/` is installed as `garment_jax/models`."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["garment_jax*"]), "garment_jax.models"],
    package_dir={"garment_jax.models": "models"},
)
