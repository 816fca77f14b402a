"""Every option that a sentence of the package names is one that a command which can say it has."""

import argparse
import ast
import dataclasses
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from garment_jax.cli import COMMANDS, make_parser
from garment_jax.config import Config
from garment_jax.importers.finding import _CHECKED_WITH, refusal

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "garment_jax"
BUILT = re.compile(
    r"(?<![\w-])--([a-z-]*\{\}[a-z-]*(?:\{\}[a-z-]*)*)(?![\w.])"
)  # an option with a part filled in
OPTION = re.compile(r"(?<![\w-])--([a-z][\w.-]*\w)")
FOREIGN = {
    "io/formats/blender.py",
    "cli/__init__.py",
    "cli/parser.py",
}  # another program's command line; the parser of all


def words_of(node: ast.AST) -> str | None:
    """A string as it stands, with {} for what is filled in; None for what is no string."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values)
    return None


def is_next(node: ast.AST) -> bool:
    """Whether a node calls `say_next` with the words of a command."""
    return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "say_next"


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def sentences(path: Path) -> tuple[tuple[int, str], ...]:
    """The strings of a module, by line, without its docstrings."""
    tree, found = parsed(path), []
    skipped: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr):
            skipped.add(id(node.value))
        if isinstance(node, ast.JoinedStr):
            skipped |= {id(value) for value in node.values}
        if is_next(node):  # a command line, which is parsed whole
            skipped |= {id(part) for part in ast.walk(node)}
    for node in ast.walk(tree):
        if (words := words_of(node)) is not None and id(node) not in skipped:
            found.append((node.lineno, words))  # type: ignore[attr-defined]
    return tuple(found)


@cache
def imported(path: Path) -> frozenset[Path]:
    """The modules of the package that a module names in its imports, those in functions too."""
    found: set[Path] = set()
    for node in ast.walk(parsed(path)):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            file = ROOT / (name.replace(".", "/") + ".py")
            if name.startswith("garment_jax.") and file.is_file():
                found.add(file)
    return frozenset(found)


def reached(start: Path) -> set[Path]:
    """The modules that `start` imports, directly or not, and itself."""
    seen, todo = set(), [start]
    while todo:
        if (path := todo.pop()) not in seen:
            seen.add(path)
            todo += imported(path)
    return seen


def options_of(parser: argparse.ArgumentParser) -> set[str]:
    """The options of a command, those of its subcommands too."""
    found = {name[2:] for action in parser._actions for name in action.option_strings if name[:2] == "--"}
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found |= set().union(*(options_of(below) for below in action.choices.values()))
    return found


def options_of_script(path: Path) -> set[str]:
    """The options that a script outside the package adds to its parser."""
    calls = [node for node in ast.walk(parsed(path)) if isinstance(node, ast.Call)]
    named = [
        words_of(arg)
        for call in calls
        if getattr(call.func, "attr", "") == "add_argument"
        for arg in call.args
    ]
    return {name[2:] for name in named if name and name.startswith("--")}


def programs() -> dict[str, tuple[Path, set[str]]]:
    """Name -> file and options of every command, of train.py and of infer.py."""
    (commands,) = (a for a in make_parser()._actions if isinstance(a, argparse._SubParsersAction))
    files = [Path(command.__file__ or "") for command in COMMANDS]
    found = {
        name: (file, options_of(parser))
        for (name, parser), file in zip(commands.choices.items(), files, strict=True)
    }
    for script in (ROOT / "train.py", ROOT / "infer.py", *sorted((ROOT / "benchmarks").glob("*.py"))):
        found[script.name] = (script, options_of_script(script))
    for name in ("infer", "train"):  # the same commands
        found[f"{name}.py"][1].update(found[name][1])
    for name in ("train", "train.py"):
        found[name][1].update(KEYS)
    return found


@cache
def names_in(node: ast.AST) -> frozenset[str]:
    """All names and attributes that a piece of a module speaks of: what it can call is among them."""
    nodes = list(ast.walk(node))
    attributes = {n.attr for n in nodes if isinstance(n, ast.Attribute)}
    return frozenset(attributes | {n.id for n in nodes if isinstance(n, ast.Name)})


def functions_reached(script: str) -> Iterator[tuple[Path, ast.AST]]:
    """The functions and classes that a script can come to, by their names alone: more than it calls."""
    there: dict[str, list[tuple[Path, ast.AST]]] = {}
    for module in REACHED[script]:
        for node in parsed(module).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                there.setdefault(node.name, []).append((module, node))
    seen, todo = set(), set(names_in(parsed(ROOT / script)))
    while todo:
        seen.add(name := todo.pop())
        for module, node in there.get(name, []):
            yield module, node
            todo |= names_in(node) - seen


KEYS = {f"{section}.{key}" for section, keys in dataclasses.asdict(Config()).items() for key in keys}
SECTIONS = "|".join(field.name for field in dataclasses.fields(Config))
KEY = re.compile(rf"(?<![\w.-])((?:{SECTIONS})\.[a-z_]+)(?![\w/])")
ROOMS = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
FILES = (".h5", ".npz", ".bin", ".log", ".jsonl", ".toml", ".safetensors", ".tar", ".step")
PROGRAMS = programs()
REACHED = {name: reached(file) for name, (file, _) in PROGRAMS.items()}
MODULES = sorted(path for path in PACKAGE.rglob("*.py") if str(path.relative_to(PACKAGE)) not in FOREIGN)


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_options_in_sentences_exist(module: Path) -> None:
    own = [options for name, (_, options) in PROGRAMS.items() if module in REACHED[name]]
    for line, words in sentences(module):
        named = [
            options for name, (_, options) in PROGRAMS.items() if re.search(rf"\b{re.escape(name)}\b", words)
        ]
        known = set().union(*own, *named)
        for option in OPTION.findall(words):
            assert option in known, f"{module.name}:{line}: no command that says it has --{option}: {words!r}"
        for option in BUILT.findall(words):
            form = re.escape(option.rstrip("-")).replace(r"\{\}", r"[\w-]+")
            assert any(re.fullmatch(form, one) for one in known), f"{module.name}:{line}: --{option}"


NEXT = [(path, node) for path in MODULES for node in ast.walk(parsed(path)) if is_next(node)]


@pytest.mark.parametrize(("module", "call"), NEXT, ids=lambda part: getattr(part, "stem", ""))
def test_what_to_do_next_is_a_command(module: Path, call: ast.Call) -> None:
    """With a name for each value; of lists that may be empty, with none or one."""

    def words(of_a_list: list[str]) -> list[str]:
        parts = ((of_a_list if isinstance(arg, ast.Starred) else [words_of(arg) or "x"]) for arg in call.args)
        return [word for part in parts for word in part]

    command, named = (*words([]), "x")[:2]
    assert command != "train" or named == "x" or (ROOT / f"configs/{named}.toml").is_file()
    wrong = []
    for of_a_list in ([], ["x"]):
        try:
            make_parser().parse_args(words(of_a_list))
        except SystemExit:
            wrong.append(words(of_a_list))
    assert len(wrong) < 2, f"{module.name}:{call.lineno}: {wrong[0]}"


def test_commands_say_what_to_do_next() -> None:
    said = {module.stem for module, _ in NEXT}
    assert {"import_", "evaluate", "render", "simulate", "validate", "train", "save", "learn"} <= said


@pytest.mark.parametrize("script", ["infer.py", "train.py"])
def test_a_script_that_says_an_option_has_it(script: str) -> None:
    """A module serves several commands; what a script can come to names its options, or whose they are."""
    for module, node in functions_reached(script):
        last = node.end_lineno or 0  # type: ignore[attr-defined]
        for line, words in sentences(module):
            if "--" in words and node.lineno <= line <= last:  # type: ignore[attr-defined]
                named = [
                    o for name, (_, o) in PROGRAMS.items() if re.search(rf"\b{re.escape(name)}\b", words)
                ]
                lacking = set(OPTION.findall(words)) - set().union(PROGRAMS[script][1], *named)
                assert not lacking, f"{module.name}:{line}: {script} has no {lacking}: {words!r}"


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_configuration_keys_in_sentences_exist(module: Path) -> None:
    for line, words in sentences(module):
        for key in KEY.findall(words) if " " in words else ():
            section, _, rest = key.partition(".")
            function = hasattr(import_module(f"garment_jax.{section}"), rest) if section in ROOMS else False
            assert key in KEYS or function or key.endswith(FILES), (
                f"{module.name}:{line}: there is no {key}: {words!r}"
            )


def test_validate_says_whose_option_it_names(tmp_path: Path) -> None:
    """What `validate` has itself stands as it is; the rest is said to be the import's."""
    path = tmp_path / "me.npz"
    theirs = refusal(ValueError(f"{path}: the body is 170 m large; give --body-unit, for example cm."), path)
    assert theirs.remedy == "give --body-unit, for example cm when it is imported"
    own = refusal(ValueError(f"{path}: it has no rate; give it with --fps."), path)
    assert own.remedy == "give it with --fps"
    assert set(_CHECKED_WITH) <= {f"--{option}" for option in PROGRAMS["validate"][1]}
