"""Command lines run in forks of one process that has imported what they use, so that each begins at once."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

PROGRAMS = ("train.py", "infer.py")


def run_words(words: Sequence[str]) -> int:
    """Run a command of `garment-jax`, or one of `PROGRAMS`, in this process; return its exit code."""
    import sys

    if words[0] in PROGRAMS:
        import importlib

        sys.argv = list(words)
        return importlib.import_module(words[0].removesuffix(".py")).main()
    from garment_jax.cli import main

    return main(list(words))


def share_programs(folder: Path) -> None:
    """Keep what jax compiles in `folder`, for all forks; call it before jax is imported."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # as `import garment_jax` does
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ["GARMENT_JAX_CACHE"] = "off"  # it would be written to at every start; XLA's is read alone
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
    os.environ["JAX_COMPILATION_CACHE_MAX_SIZE"] = "-1"  # no times of use, which a kill would tear


def in_a_fork(work: Callable[[Path], None], folder: Path) -> None:
    """Do `work` in a fork: jax must not have begun to compute in a process that is to be forked."""
    child = os.fork()
    if child == 0:
        try:
            work(folder)
            os._exit(0)
        except BaseException:
            import traceback

            traceback.print_exc()
        finally:
            os._exit(1)
    if os.waitpid(child, 0)[1]:
        raise RuntimeError("the inputs could not be made")
