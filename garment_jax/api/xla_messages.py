"""What XLA says of its own caches, kept from the user."""

import os


def hush_xla() -> None:
    """Call before anything imports jax, whose C++ reads the setting when it is loaded.

    With AVX-512 XLA takes each program from a cache for one made on another machine (jax issue 38445) and
    says so at length; ours are kept by processor.
    """
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
