"""The attributes that a sequence file must have, and their checks."""

from collections.abc import Mapping

import h5py

from garment_jax.io.hdf5 import attributes_of, has
from garment_jax.io.layout import SCHEMA_VERSION


def check_attributes(file: h5py.File, where: str) -> dict:
    """Return a sequence file's attributes, or raise ValueError for a version or unit that is not read."""
    attributes = attributes_of(file, where)
    if has(file, "vertices_delta", where):
        raise ValueError(
            f"{where} is packed for transport; run `garment-jax import {where} --out DIR` first."
        )
    version = attributes.get("schema_version")
    if version != SCHEMA_VERSION:
        raise ValueError(
            f"{where}: schema_version is {version}, this release reads {SCHEMA_VERSION}; import the clip "
            "again with this release."
        )
    check_units(attributes, where)
    return attributes


def check_units(attributes: Mapping[str, object], where: str) -> None:
    """Raise ValueError unless frame rate, length unit and up axis are there and are what is read."""
    if "fps" not in attributes:
        raise ValueError(f"{where}: attribute fps is missing; set it to the clip's true frame rate.")
    fps = attributes["fps"]
    if not isinstance(fps, int | float) or not 0 < fps < 10_000:
        raise ValueError(f"{where}: fps is {fps!r}; set it to the clip's true frame rate, a number above 0.")
    for key, expected, remedy in (
        ("length_unit", "m", "convert all lengths to metres"),
        ("up_axis", "Y", "turn the clip so that Y is up"),
    ):
        if attributes.get(key) != expected:
            raise ValueError(
                f"{where}: {key} is {attributes.get(key)!r}, only {expected!r} is read; {remedy} and set "
                f"{key} to {expected!r}."
            )
