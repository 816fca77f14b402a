"""What every test shares: CPU, x64 off, warnings and silent broadcasting as errors, the shared data."""

import gc

gc.disable()  # until all is imported, see `pytest_collection_finish`

import os
import signal
from collections.abc import Iterator
from pathlib import Path

# Before jax is imported. The suite mostly compiles: without XLA's costlier passes, and with a persistent
# cache, it takes two thirds of the time. Set to 0, the tests run what users run.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
if os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] == "1":  # half the time of what is left in large programs
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false")
os.environ.setdefault("JAX_PLATFORMS", "cpu")
ROOT = Path(__file__).resolve().parents[1]
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(ROOT / ".cache" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.3")
# XLA's false alarm about every program from that cache (jax issue 38445), 1.5 KB each on AVX-512
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ["GARMENT_JAX_CACHE"] = "off"  # the user's own cache is none of the tests' business

import jax
import pytest
from jaxtyping import install_import_hook

import tests.shape_checks  # noqa: F401 (the hook looks it up as an attribute)

# Shapes and types of every annotated function are checked while tests run, and only then.
_CHECKED = install_import_hook("garment_jax", "tests.shape_checks.checked")

jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "standard")


def pytest_collection_finish() -> None:
    """Put what jax, the package and all tests are made of out of the garbage collector's sight.

    It goes through those millions of objects again and again otherwise, a tenth of the suite's time; and
    where JAX traces it comes after every 700 new objects, a twentieth.
    """
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for what is made once a run: all workers have the same."""
    own = tmp_path_factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


@pytest.fixture(autouse=True, scope="session")
def programs_built_once(run_folder: Path) -> Iterator[None]:
    """Rollouts' and collision handling's programs, by the names under which a user's cache would keep them.

    XLA's cache spares the tests compiling them again, but not tracing them: ten seconds, in dozens of tests.
    """
    from garment_jax import aot_cache

    known: dict[tuple[str, str], tuple] = {}
    build, kept = aot_cache.ProgramStore._built, aot_cache.ProgramStore(run_folder / "programs")

    def built(store, name: str, jitted, arguments: tuple, facts, *asked):
        shared = facts and name.startswith(("rollout", "shape", "contacts"))  # without facts it has no name
        if store._folder is not None or not shared:
            return build(store, name, jitted, arguments, facts, *asked)
        key = name, aot_cache._key(arguments, facts)
        if key not in known:
            known[key] = build(kept, name, jitted, arguments, facts, *asked)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(aot_cache.ProgramStore, "_built", built)
        yield


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder with `avatar/`, `motion/` and `skirt/` (see CONTRIBUTING.md), or a skip."""
    path = Path(os.environ.get("GARMENT_JAX_SHARED", ROOT.parent / "shared" / "data"))
    if not (path / "skirt").is_dir():
        pytest.skip(f"no shared data at {path}; set GARMENT_JAX_SHARED to the folder that holds skirt/")
    return path


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """The folder of small files that once went wrong, each with a README, or a skip."""
    path = Path(os.environ.get("GARMENT_JAX_SHARED", ROOT.parent / "shared" / "data")).parent / "cases"
    if not path.is_dir():
        pytest.skip(f"no shared cases at {path}; set GARMENT_JAX_SHARED to the folder data/ beside them")
    return path


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Python's own handler of Ctrl-C, for a test that sends it to itself or to a child.

    A shell starts its background jobs with interrupts ignored (`nohup make test &`), and children inherit it.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
