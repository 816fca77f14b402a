"""The configuration: files, overrides and the sentence for each mistake."""

import dataclasses
import math
import tomllib
from pathlib import Path
from typing import Literal, get_args, get_origin, get_type_hints

import pytest

from garment_jax.config import (
    Config,
    apply_overrides,
    from_dict,
    load_config,
    reading,
    to_dict,
    to_toml,
)
from garment_jax.config.key import metadata

CONFIGS = Path(__file__).parents[2] / "configs"
# benchmark*.toml say which of these are compared: another schema (tests/bench/test_settings.py)
SHIPPED = sorted(set(CONFIGS.glob("*.toml")) - set(CONFIGS.glob("benchmark*.toml")))


@dataclasses.dataclass(frozen=True)
class Kinds:
    """A section with every type that a field may have."""

    whole: int = 3
    number: float = 1e-5
    switch: bool = True
    text: str = 'a "quoted" \\ é 🩰'
    choice: Literal["a", "b"] = "a"
    widths: tuple[int, ...] = (1, 2)
    names: tuple[str, ...] = ()
    rates: tuple[float, ...] = (0.5, 2.0)
    limit: int | None = None


@dataclasses.dataclass(frozen=True)
class KindsConfig(Config):
    kinds: Kinds = dataclasses.field(default_factory=Kinds)


@pytest.fixture
def kinds(monkeypatch: pytest.MonkeyPatch) -> type[KindsConfig]:
    """The same machinery with that section as well, which stays as it is when the others grow."""
    monkeypatch.setattr(reading, "Config", KindsConfig)
    return KindsConfig


def changed_everywhere() -> Config:
    """A configuration in which every field differs from its default."""

    def other(field: dataclasses.Field, hint: object, value: object) -> object:
        key = field.name
        if key == "size":
            return 96  # which five convolutions halve
        if key == "around":
            return 3  # odd
        if metadata(field).check == "part":
            return 1.0 - value  # type: ignore[operator]
        if get_origin(hint) is tuple:
            return (*value, get_args(hint)[0](1))  # type: ignore[misc, index]
        if get_origin(hint) is Literal:
            return next(choice for choice in get_args(hint) if choice != value)
        return not value if isinstance(value, bool) else value + type(value)(1)  # type: ignore[operator]

    def section(old: object) -> object:
        hints = get_type_hints(type(old))
        changed = {f.name: other(f, hints[f.name], getattr(old, f.name)) for f in dataclasses.fields(old)}  # type: ignore[arg-type]
        return dataclasses.replace(old, **changed)  # type: ignore[type-var]

    return Config(**{f.name: section(getattr(Config(), f.name)) for f in dataclasses.fields(Config)})  # type: ignore[arg-type]


@pytest.mark.parametrize("config", [Config(), changed_everywhere()], ids=["defaults", "changed"])
def test_toml_and_dict_round_trips_are_exact(config: Config, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text(to_toml(config), encoding="utf-8")
    assert load_config(tmp_path / "c.toml") == config
    assert from_dict(to_dict(config)) == config


@pytest.mark.usefixtures("kinds")
def test_every_kind_of_field_round_trips() -> None:
    for value in (Kinds(), Kinds(limit=4, names=("x", "y"), rates=(), switch=False, choice="b")):
        config = KindsConfig(kinds=value)
        assert from_dict(tomllib.loads(to_toml(config))) == config


ODD = "".join(map(chr, range(0x20))) + "\x7f\x80\x9f\u2028\ufeff\uffff\U0010ffff'\"\\/#=[]{}none"


@pytest.mark.usefixtures("kinds")
@pytest.mark.parametrize(
    "value",
    [
        Kinds(text=ODD, names=(ODD, "", "none", "1", "true", '"""', "\\u0041", "\r\n")),
        Kinds(text="none"),
        Kinds(number=5e-324, rates=(1.7976931348623157e308, 1e16, 1e22, 0.1 + 0.2, 0.0)),
        Kinds(whole=2**31 - 1, widths=(0, 2**31 - 1), limit=2**31 - 1),
    ],
)
def test_what_is_written_is_read_again(value: Kinds, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text(to_toml(KindsConfig(kinds=value)), encoding="utf-8")
    assert load_config(tmp_path / "c.toml") == KindsConfig(kinds=value)


@pytest.mark.usefixtures("kinds")
@pytest.mark.parametrize(
    "words",
    [
        ["--kinds.text", "caf\udce9"],  # a byte of another encoding, as the command line has it
        ["--kinds.names", "a,caf\udce9"],
        ["--kinds.number", "inf"],
        ["--kinds.rates", "1,nan"],
        ["--kinds.number", "1e999"],
        ["--kinds.whole", "9" * 400],
        ["--kinds.whole", "9" * 5000],
        ["--kinds.whole", "-" + "9" * 400],
        ["--kinds.limit", "9" * 30],
    ],
)
def test_what_could_not_be_read_again_is_refused(words: list[str], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"^command line: kinds\.\w+ "):
        apply_overrides(KindsConfig(), words)
    for text in ("number", "whole", "rates"):
        for digits in (400, 5000):
            value = "9" * digits
            entry = f"[{value}]" if text == "rates" else value
            (tmp_path / "c.toml").write_text(f"[kinds]\n{text} = {entry}\n")
            with pytest.raises(ValueError, match=r"^\S*c\.toml(: kinds\.| is not valid TOML)"):
                load_config(tmp_path / "c.toml")


@pytest.mark.usefixtures("kinds")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--kinds.whole", "5"], Kinds(whole=5)),
        (["--kinds.number=2"], Kinds(number=2.0)),
        (["--kinds.switch", "false"], Kinds(switch=False)),
        (["--kinds.text", "--x=y"], Kinds(text="--x=y")),
        (["--kinds.choice=b"], Kinds(choice="b")),
        (["--kinds.widths", "4, 5,6"], Kinds(widths=(4, 5, 6))),
        (["--kinds.names", ""], Kinds(names=())),
        (["--kinds.limit", "9", "--kinds.limit", "none"], Kinds(limit=None)),
    ],
)
def test_overrides_by_type(words: list[str], expected: Kinds) -> None:
    assert apply_overrides(KindsConfig(), words) == KindsConfig(kinds=expected)


@pytest.mark.usefixtures("kinds")
@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"whole": 1.5}, r"test\.toml: kinds\.whole = 1\.5 must be a whole number"),
        ({"whole": True}, r"kinds\.whole = True must be a whole number"),
        ({"number": "1"}, r"kinds\.number = '1' must be a number"),
        ({"number": math.nan}, r"kinds\.number = nan must be a finite number, 0 or greater"),
        ({"whole": -1}, r"kinds\.whole = -1 must be a finite number, 0 or greater"),
        ({"switch": 1}, r"kinds\.switch = 1 must be true or false"),
        ({"text": 1}, r"kinds\.text = 1 must be a string"),
        ({"choice": "c"}, r"kinds\.choice = 'c' is not one of 'a', 'b'"),
        ({"widths": 3}, r"kinds\.widths = 3 must be a list; write \[3\]"),
        ({"widths": [1, "2"]}, r"kinds\.widths = '2' must be a whole number"),
        ({"limit": "many"}, r"kinds\.limit = 'many' must be a whole number"),
        ({"number": 10**5000}, r"test\.toml: kinds\.number is a number of 16610 bits; give a smaller one"),
        ({"whole": -(10**400)}, r"kinds\.whole is a number of 1329 bits"),
        ({"text": 10**5000}, r"kinds\.text is a number of 16610 bits"),
        (
            {"wdths": [1]},
            r"unknown key in \[kinds\] 'wdths'; known are whole, .* mean 'widths'\?",
        ),
    ],
)
def test_wrong_entries_are_refused_by_name_value_and_remedy(entries: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        from_dict({"kinds": entries}, source="test.toml")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--uv.sise", "3"],
            r"command line: unknown key in \[uv\] 'sise'; known are .* mean 'size'\?",
        ),
        (["--uvv.size", "3"], r"unknown section 'uvv'; known are data, .*\. Did you mean 'uv'\?"),
        (["--uv.size", "0"], r"uv\.size = 0 must be a finite number, greater than 0"),
        (
            ["--detail.steps", "99999999999"],
            r"detail\.steps = 99999999999 is out of range; give 2147483647",
        ),
        (
            ["--training.log_every", "-1"],
            r"training\.log_every = -1 must be a finite number, greater than 0",
        ),
        (["--uv.size", "big"], r"uv\.size = 'big' must be a whole number"),
        (["--data.mirror", "yes"], r"data\.mirror = 'yes' must be true or false"),
        (["--uv.size"], r"--uv\.size has no value; write --uv\.size VALUE"),
        (["uv.size", "3"], r"'uv\.size' is not an override; write --SECTION\.KEY VALUE"),
        (["--stage", "all"], r"'--stage' is not an override"),
        (
            ["--motion.dropout", "3"],
            r"motion\.dropout = 3\.0 is a part of a whole; give a number from 0 to 1",
        ),
        (["--training.warmup", "-0.1"], r"warmup = -0\.1 is a part of a whole"),
        (["--generative.channels="], r"generative\.channels is empty; give a width for each"),
        (
            ["--uv.size", "7"],
            r"uv\.size = 7 cannot be halved by each of 4 convolutions \(generative\.channels\)",
        ),
        (["--motion.channels", "1,1,1,1,1,1,1"], r"\(motion\.channels\); give a multiple of 128"),
    ],
)
def test_wrong_overrides_are_refused(words: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        apply_overrides(Config(), words)


def test_the_packages_configurations_are_known_by_name(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_config("demo") == load_config(CONFIGS / "demo.toml")
    (tmp_path / "demo").write_text("[uv]\nsize = 16\n")
    assert load_config("demo").uv.size == 16  # a file of the user's comes first
    with pytest.raises(FileNotFoundError, match="No configuration file 'dmo'"):
        load_config("dmo")


def test_wrong_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"No configuration file '.*none\.toml'"):
        load_config(tmp_path / "none.toml")
    file = tmp_path / "c.toml"
    file.write_text("[uv]\nsize 3\n")
    with pytest.raises(ValueError, match=r"c\.toml is not valid TOML: .*line 2.*; correct that line"):
        load_config(file)
    file.write_text("uv = 3\n")
    with pytest.raises(ValueError, match=r"uv = 3 is a section; write \[uv\]"):
        load_config(file)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_shipped_configurations_load_and_their_head_names_the_command(path: Path) -> None:
    load_config(path)
    head = path.read_text(encoding="utf-8").split("[", 1)[0]
    assert f"python train.py configs/{path.name}" in head


def test_the_local_dynamics_of_older_models_are_dropped_and_refused_where_they_moved_the_cloth():
    table = to_dict(Config()) | {"dynamics": {"steps": 0, "patch": 4}}
    assert from_dict(table) == Config()
    with pytest.raises(ValueError, match=r"\[dynamics\] has steps = 3000, and local dynamics are no more"):
        from_dict(to_dict(Config()) | {"dynamics": {"steps": 3000}})
    with pytest.raises(ValueError, match="unknown section 'dynamic'"):
        from_dict({"dynamic": {"steps": 0}})


@pytest.mark.parametrize("change", [{"around": 4}, {"columns": 3}, {"hidden": 0}, {"window": 1}])
def test_a_ring_that_is_none_is_refused(change: dict):
    with pytest.raises(ValueError, match="give an odd number around, no more than there are columns"):
        from_dict({"column_rnn": change})
