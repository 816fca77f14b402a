"""The rooms and who may import whom: down the list only; networks live in the three stages."""

import ast
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "garment_jax"

# A room may import itself and those above it, except the first five, which import nobody.
ROOMS = (
    "structs",
    "config",
    "storage",
    "progress",
    "machine",
    "aot_cache",
    "farm",
    "geometry",
    "body",
    "procedural",
    "io.formats",
    "io",
    "dataset",
    "importers",
    "validation",
    "model.generative",
    "model.motion",
    "model.detail",
    "model.column_rnn",
    "model",
    "postprocess.collision",
    "postprocess",
    "animation",
    "evaluation",
    "simulation",
    "training",
    "baselines",
    "stability",
    "exporters",
    "viewer",
    "learning",
    "bench",
    "api",
    "cli",
)
MODULES = sorted(PACKAGE.rglob("*.py"))
NETWORK_ROOMS = {"model.generative", "model.motion", "model.detail"}
FORBIDDEN_NAMES = {"utils", "helpers", "common", "misc"}


def room_named(parts: Sequence[str]) -> str:
    """The room of a name below the package; a room within another, as `io.formats`, is one of its own."""
    return next((name for name in (".".join(parts[:2]), parts[0]) if name in ROOMS), parts[0])


def room_of(path: Path) -> str:
    """The room of a module; "" for the files of the package, and of folders that hold rooms alone."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    room = room_named(parts)
    doors = parts[-1].startswith("__") and (len(parts) == 1 or room not in ROOMS)
    return "" if doors else room


def imports(path: Path) -> Iterator[str]:
    """Absolute dotted names of what a module imports, those inside functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = path.relative_to(PACKAGE.parent).parts[: -node.level] if node.level else ()
            stem = ".".join([*base, *filter(None, [node.module])])
            yield from (f"{stem}.{alias.name}" for alias in node.names)


def circles(edges: Mapping[str, set[str]]) -> list[str]:
    """One path back to its start, "a > b > a", of a graph of imports; empty where it has none."""
    done: set[str] = set()

    def search(name: str, above: tuple[str, ...]) -> list[str]:
        if name in above:
            return [*above[above.index(name) :], name]
        if name not in done:
            for other in sorted(edges[name]):
                if found := search(other, (*above, name)):
                    return found
            done.add(name)
        return []

    for name in sorted(edges):
        if found := search(name, ()):
            return found
    return []


def modules_imported(path: Path, known: Mapping[str, Path]) -> set[str]:
    """Modules of `known` that a module imports: of `a.b.c.name` the longest that is one."""
    found = set()
    for name in imports(path):
        while name and name not in known:
            name = name.rpartition(".")[0]
        found |= {name} if name and known[name] != path else set()
    return found


def wrong_rooms(room: str, names: list[str]) -> list[str]:
    """Those of `names` that a module of `room` may not import."""
    if room == "":  # __init__ and __main__ hold no knowledge of their own, only doors
        return []
    allowed = {room} if room in ROOMS[:5] else set(ROOMS[: ROOMS.index(room) + 1])
    ours = [name for name in names if name.split(".")[0] == "garment_jax"]
    return [name for name in ours if room_named(name.split(".")[1:]) in set(ROOMS) - allowed]


def name_of(path: Path) -> str:
    return str(path.relative_to(PACKAGE))


def test_every_room_is_in_the_list() -> None:
    found = {room_of(path) for path in MODULES} - {""}
    assert found <= set(ROOMS), (
        f"new rooms {sorted(found - set(ROOMS))} need a place in ROOMS and CONTRIBUTING.md"
    )


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_go_down_the_list(path: Path) -> None:
    assert wrong_rooms(room_of(path), list(imports(path))) == []


def test_no_module_imports_itself_by_way_of_others() -> None:
    parts = {path: path.relative_to(PACKAGE.parent).with_suffix("").parts for path in MODULES}
    known = {".".join(p[:-1] if p[-1] == "__init__" else p): path for path, p in parts.items()}
    assert circles({name: modules_imported(path, known) for name, path in known.items()}) == []


def test_circles_are_found() -> None:
    assert circles({"a": {"b", "c"}, "b": {"d"}, "c": {"a"}, "d": set()}) == ["a", "c", "a"]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_networks_are_imported_in_the_stages_only(path: Path) -> None:
    if room_of(path) not in NETWORK_ROOMS:
        networks = [name for name in imports(path) if name.split(".")[0] == "flax"]
        assert [name for name in networks if not name.startswith("flax.traverse_util.")] == []


def test_no_file_or_folder_is_a_drawer_for_anything() -> None:
    assert [name_of(path) for path in PACKAGE.rglob("*") if path.stem in FORBIDDEN_NAMES] == []


def test_the_reader_sees_every_form_of_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.PACKAGE", tmp_path / "garment_jax")
    module = tmp_path / "garment_jax" / "body" / "seeds.py"
    module.parent.mkdir(parents=True)
    module.write_text(
        "import garment_jax.io.sequence as s\nfrom garment_jax import cli\nfrom ..animation import scan\n"
        "from . import frame\ndef f():\n    from garment_jax.geometry.topology import unique_edges\n"
    )
    names = list(imports(module))
    assert names == [
        "garment_jax.io.sequence",
        "garment_jax.cli",
        "garment_jax.animation.scan",
        "garment_jax.body.frame",
        "garment_jax.geometry.topology.unique_edges",
    ]
    assert wrong_rooms("body", names) == names[:3]
    assert wrong_rooms("structs", ["garment_jax.config.Config"]) == ["garment_jax.config.Config"]
