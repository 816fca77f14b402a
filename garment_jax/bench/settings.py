"""What `configs/benchmark.toml` says: the rows of the benchmark, their budget and their order.

Read and checked as `config` checks an experiment: an unknown key, a wrong type or a value out of
range is refused with its name, its value and what would do.
"""

import dataclasses
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_origin, get_type_hints

from garment_jax.config import Config, from_dict, load_config, to_dict
from garment_jax.config.reading import find_config, refuse_unknown
from garment_jax.config.values import checked

OURS = "ours"
SEARCH, SEEDS = "search", "seeds"  # words of `order` that stand for no group
_TRAINED = ("generative", "motion", "detail", "baselines")  # sections with steps and learning rates


@dataclass(frozen=True)
class Row:
    """One line of the tables: a method, what differs from the base, and how it is rolled out."""

    name: str
    title: str
    group: str
    method: str = OURS  # or a name in `baselines.METHODS`
    task: Literal["rollout", "reconstruction"] = "rollout"
    seeds: tuple[int, ...] = (0,)
    set: dict[str, Any] = field(default_factory=dict)  # sections and keys over the base's
    detail: bool = True  # of a rollout of ours
    collision: bool = True  # limbs and collisions handled in a rollout, as `set.collision` says
    precision: Literal["float32", "bfloat16"] = "float32"  # of the parameters, in the rollout
    part: float = 1.0  # of the training clips
    length: float = 1.0  # of every number of steps


@dataclass(frozen=True)
class Search:
    """The same small search over the learning rate for every method named."""

    methods: tuple[str, ...] = ()
    factors: tuple[float, ...] = (0.3, 1.0, 3.0)  # of every learning rate
    length: float = 0.5  # of every number of steps


@dataclass(frozen=True)
class Timing:
    """How run time is measured."""

    clip: str = ""  # a test clip; the longest if not named
    frames: int = 600  # of it at most
    steps: int = 300  # frames of the single-step measurement
    batch: int = 8  # motions side by side in the throughput


@dataclass(frozen=True)
class Benchmark:
    """The whole file."""

    title: str = "Error against run time"
    data: str = ""  # default of --data; the base experiment's if empty
    out: str = "runs/benchmark"  # default of --out
    base: str = ""  # experiment that every row begins from, relative to this file
    budget: dict[str, Any] = field(default_factory=dict)  # sections and keys over the experiment's
    order: tuple[str, ...] = ("main", "search", "seeds")  # groups of rows; search and seeds in between
    test: tuple[str, ...] = ()  # names of test clips; all if empty
    every: int = 30  # slow metrics (Hausdorff, penetration, self-intersections) on each so many frames
    lengths: tuple[int, ...] = (100, 500, 1200)  # frames whose error along the rollout is told
    again: str = ""  # default of --again: folder of the test clips' second simulations
    simulator_frames: int = 20  # frames simulated to time the simulator; 0 leaves it open
    reference: str = OURS  # name of the row that ratios are of
    compared_with: Literal["skirt", "vto"] = "skirt"  # the paper's ratios that stand beside: Table 3 or 4
    search: Search = field(default_factory=Search)
    timing: Timing = field(default_factory=Timing)
    rows: tuple[Row, ...] = ()


class Loaded:
    """A checked benchmark, its base configuration and the folder that its paths are relative to."""

    def __init__(self, settings: Benchmark, base: Config, folder: Path) -> None:
        self.settings, self.base, self.folder = settings, base, folder

    def row(self, name: str) -> Row:
        """Return the row of that name; ValueError names the known ones."""
        rows = {row.name: row for row in self.settings.rows}
        if name not in rows:
            raise ValueError(f"--only: unknown row {name!r}; known are {', '.join(rows)}.")
        return rows[name]


def load_benchmark(path: str | Path) -> Loaded:
    """Read and check a benchmark's TOML file, or one of the package's by name, and the experiment it names.

    `FileNotFoundError` for a missing file, `ValueError` for what does not fit, by name.
    """
    path = find_config(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not valid TOML: {error}; correct that line.") from error
    return _checked_benchmark(table, path)


def _checked_benchmark(table: Mapping[str, Any], path: Path) -> Loaded:
    source = str(path)
    table = dict(table)
    rows = tuple(_section(Row, entry, f"{source}: [[row]]") for entry in table.pop("row", []))
    parts = {
        "search": _section(Search, table.pop("search", {}), f"{source}: [search]"),
        "timing": _section(Timing, table.pop("timing", {}), f"{source}: [timing]"),
    }
    _refuse_known_elsewhere(table, source)
    settings = dataclasses.replace(_section(Benchmark, table, source), rows=rows, **parts)
    if not settings.base:
        raise ValueError(f'{source}: base is missing; name an experiment such as base = "skirt.toml".')
    base = merged(load_config(path.parent / settings.base), settings.budget, source=f"{source}: [budget]")
    _check_rows(settings, base, source)
    return Loaded(settings, base, path.parent)


def merged(config: Config, changes: Mapping[str, Any], *, source: str) -> Config:
    """Return `config` with nested `changes` (section -> key -> value) put in, or `ValueError`."""
    table = to_dict(config)
    for section, entries in changes.items():
        if not isinstance(entries, Mapping):
            raise ValueError(f"{source}: {section} = {entries!r} is a section; write {section}.KEY = VALUE.")
        table.setdefault(section, {})
        table[section] = table[section] | dict(entries)
    return from_dict(table, source=source)


def scaled(config: Config, *, length: float = 1.0, rate: float = 1.0) -> Config:
    """Return `config` with numbers of steps times `length` (1 at least) and learning rates times `rate`.

    The column RNN keeps its rate: the search is the latents', which it never reads.
    """

    def section(values: Any, rate: float) -> Any:
        changed = {}
        for item in dataclasses.fields(values):
            value = getattr(values, item.name)
            if item.name.endswith("steps") and value:
                changed[item.name] = max(round(value * length), 1)
            elif item.name.endswith("rate"):
                changed[item.name] = value * rate
        return dataclasses.replace(values, **changed)

    changed = {name: section(getattr(config, name), rate) for name in _TRAINED}
    return dataclasses.replace(config, **changed, column_rnn=section(config.column_rnn, 1.0))


def row_config(loaded: Loaded, row: Row, seed: int, *, rate: float = 1.0, length: float = 1.0) -> Config:
    """Return the whole configuration of a row's run: base, the row's own values, scaled, with its seed."""
    own = merged(loaded.base, row.set, source=f"row {row.name}")
    config = scaled(own, length=row.length * length, rate=rate)
    return dataclasses.replace(config, training=dataclasses.replace(config.training, seed=seed))


def _check_rows(settings: Benchmark, base: Config, source: str) -> None:
    if not settings.rows:
        raise ValueError(f"{source} has no rows; write [[row]] with name, title and group.")
    names = [row.name for row in settings.rows]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{source}: two rows are called {name!r}; give one another name.")
    known = set(settings.order) - {SEARCH, SEEDS}
    for row in settings.rows:
        where = f"{source}: row {row.name}"
        if row.group not in known:
            raise ValueError(
                f"{where}: group {row.group!r} is not in order = {list(settings.order)}; add it there."
            )
        if not row.seeds:
            raise ValueError(f"{where}: seeds is empty; write seeds = [0].")
        if not 0 < row.part <= 1:
            raise ValueError(f"{where}: part = {row.part:g} must lie above 0 and be at most 1.")
        if not row.length > 0:
            raise ValueError(f"{where}: length = {row.length:g} must be above 0; 1 is the budget.")
        merged(base, row.set, source=where)
    if settings.reference not in names:
        raise ValueError(
            f"{source}: reference = {settings.reference!r} is no row; name one of {', '.join(names)}."
        )
    if settings.every < 1 or any(k < 1 for k in settings.lengths):
        raise ValueError(f"{source}: every and lengths count frames; write 1 or more.")
    if not settings.search.length > 0 or any(not f > 0 for f in settings.search.factors):
        raise ValueError(f"{source}: [search] length and factors must be above 0.")


def check_methods(settings: Benchmark, known: Mapping[str, Any], source: str) -> None:
    """Raise `ValueError` for a row or a search whose method is neither ours nor in `known`."""
    names = [OURS, *known]
    methods = [*(row.method for row in settings.rows), *settings.search.methods]
    refuse_unknown(methods, names, kind="method", source=source)


def _refuse_known_elsewhere(table: Mapping[str, Any], source: str) -> None:
    if "rows" in table:
        raise ValueError(f"{source}: rows are written as [[row]], one table each; rename `rows`.")


def _section(kind: type, table: Any, source: str) -> Any:
    """Return the dataclass `kind` filled from a TOML table."""
    if not isinstance(table, Mapping):
        raise ValueError(f"{source} = {table!r} is a section; write keys under it.")
    hints = get_type_hints(kind)
    refuse_unknown(table, hints, kind="key", source=source)
    missing = [f.name for f in dataclasses.fields(kind) if _required(f) and f.name not in table]
    if missing:
        raise ValueError(f"{source}: {missing[0]} is missing in {dict(table)!r}; write it.")
    return kind(**{key: _typed(key, hints[key], value, source) for key, value in table.items()})


def _required(item: dataclasses.Field) -> bool:
    return item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING


def _typed(name: str, hint: Any, value: Any, source: str) -> Any:
    if get_origin(hint) is dict:
        if not isinstance(value, Mapping):
            raise ValueError(f"{source}: {name} = {value!r} must be a table of sections.")
        return dict(value)
    return checked(name, hint, value, source, "not negative")
