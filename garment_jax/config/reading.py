"""Configurations read from TOML, nested dicts and the command line, and written again."""

import dataclasses
import difflib
import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

from garment_jax.config.former_names import current, current_key, current_names
from garment_jax.config.key import metadata
from garment_jax.config.sections import Config
from garment_jax.config.values import checked, parse

_PACKAGE = Path(__file__).resolve().parents[1]
# In a wheel `configs/` lies inside the package (setup.py), in a checkout beside it.
_PLACES = (_PACKAGE / "configs", _PACKAGE.parent / "configs")

# Limits and gains of the column RNN's correction, which goes the whole way now
_FORMER_ROLLOUT = ("amplitude", "gain", "max_correction", "reach")


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> Config:
    """Read a TOML file, or one of the package's by its name.

    Then apply overrides `--SECTION.KEY VALUE` (or `--SECTION.KEY=VALUE`).

    Tuples are comma-separated in an override. ValueError names an unknown key (with the known
    ones), a wrong type, a value out of range or a file that is not TOML; FileNotFoundError a
    missing file.
    """
    path = find_config(path)
    try:
        table = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:  # ValueError: a number of thousands of digits, too
        raise ValueError(f"{path} is not valid TOML: {error}; correct that line.") from error
    return apply_overrides(from_dict(table, source=str(path)), overrides)


def find_config(path: str | Path) -> Path:
    """Return `path` where it is a file, else the configuration of that name that comes with the package.

    Raises `FileNotFoundError` where there is neither.
    """
    named = [place / f"{path}.toml" for place in _PLACES if Path(path).name == str(path)]
    for file in (Path(path), *named):
        if file.is_file():
            return file
    raise FileNotFoundError(_no_file(Path(path)))


def _no_file(path: Path) -> str:
    """Return what is said of a configuration that is no file, with the one beside it that may be meant."""
    if path.is_dir():
        return f"{str(path)!r} is a folder; name a configuration in it, such as {path / 'skirt.toml'}."
    beside = [str(other) for other in path.parent.glob("*.toml")]
    near = difflib.get_close_matches(str(path), beside, n=1)
    own = sorted({file.stem for place in _PLACES for file in place.glob("*.toml")})
    meant = f"did you mean {near[0]}?" if near else f"the package has {', '.join(own)}."
    return f"No configuration file {str(path)!r}; {meant}"


def from_dict(table: Mapping[str, Any], *, source: str = "the configuration") -> Config:
    """Build a checked Config from nested dicts as TOML or JSON give them (inverse of `to_dict`)."""
    sections = get_type_hints(Config)
    table = current_names(_without_former_keys(table, source), source)
    refuse_unknown(table, sections, kind="section", source=source)
    built = {}
    for name, entries in table.items():
        if not isinstance(entries, Mapping):
            raise ValueError(
                f"{source}: {name} = {entries!r} is a section; write [{name}] with keys under it."
            )
        kind = sections[name]
        refuse_unknown(entries, get_type_hints(kind), kind=f"key in [{name}]", source=source)
        values = {key: _checked(kind, name, key, value, source) for key, value in entries.items()}
        built[name] = kind(**values)
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
        section = current(section)
        refuse_unknown([section], sections, kind="section", source=source)
        key = current_key(section, key)
        hints = get_type_hints(sections[section])
        refuse_unknown([key], hints, kind=f"key in [{section}]", source=source)
        text = text if equals else words.pop(0)
        value = _checked(sections[section], section, key, parse(hints[key], text), source)
        config = dataclasses.replace(
            config, **{section: dataclasses.replace(getattr(config, section), **{key: value})}
        )
    return _fitting(config, source)


def _checked(kind: Any, section: str, key: str, value: Any, source: str) -> Any:
    """`value` as the key's type, or ValueError; `kind` is the section's dataclass."""
    field = kind.__dataclass_fields__[key]
    return checked(f"{section}.{key}", get_type_hints(kind)[key], value, source, metadata(field).check)


def _fitting(config: Config, source: str) -> Config:
    """`config`, or ValueError where UV maps cannot be halved by every convolution or the ring is no ring."""
    ring = config.column_rnn
    if ring.around % 2 == 0 or ring.columns < ring.around or ring.hidden < 1 or ring.window < 2:
        raise ValueError(
            f"{source}: column_rnn.around = {ring.around}, columns = {ring.columns}, hidden = {ring.hidden}, "
            f"window = {ring.window}: give an odd number around, no more than there are columns, one hidden "
            "number and two frames at least."
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


def _without_former_keys(table: Mapping[str, Any], source: str) -> Mapping[str, Any]:
    """Return `table` without what older models name and no rollout reads any more.

    A model that limited or drew out its corrections is animated without that.
    """
    old = table.get("dynamics")
    if isinstance(old, Mapping) and old.get("steps", 0):
        raise ValueError(
            f"{source}: [dynamics] has steps = {old['steps']}, and local dynamics are no more; the "
            "column RNN takes their place: give [column_rnn] steps (configs/skirt.toml), and train again."
        )
    return {
        name: {key: value for key, value in entries.items() if key not in _FORMER_ROLLOUT}
        if name == "rollout" and isinstance(entries, Mapping)
        else entries
        for name, entries in table.items()
        if name != "dynamics"
    }


def _spell_none(entries: dict[str, Any]) -> dict[str, Any]:
    return {key: "none" if value is None else value for key, value in entries.items()}


def refuse_unknown(names: Iterable[str], known: Iterable[str], *, kind: str, source: str) -> None:
    """Raise ValueError for the first of `names` that is not known, with the known ones and the nearest."""
    known = list(known)
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1) or elsewhere(name)
            hint = f" Did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"{source}: unknown {kind} {name!r}; known are {', '.join(known)}.{hint}")


def elsewhere(key: str) -> list[str]:
    """Return SECTION.KEY of each section that has a key of this name."""
    return [f"{name}.{key}" for name, kind in get_type_hints(Config).items() if key in get_type_hints(kind)]
