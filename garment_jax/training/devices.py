"""Training over several devices and processes: a mesh with one axis of data, parameters on all of them.

Every process draws the whole batch's frames from seed and step and makes its own rows, so that N processes
see what one would; XLA's partitioner reduces gradients and metrics. Not in the paper.
"""

import os
import socket
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stderr
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import AxisType, Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from garment_jax.training.peers import LOST, Peers, connect, end_process

AXIS = "data"
CARRY = "carry"  # the field of a state whose leaves are lanes
COMING = 300  # seconds that processes are waited for at the start
_REFUSED, _FAULT, _INTERRUPTED = 2, 70, 130  # exit codes, as `garment_jax.cli` has them
_COLLATERAL = 3.0  # seconds within which the end of another process explains an error here


class Devices(NamedTuple):
    """What a training runs on; one device of one process by default, where nothing is done here."""

    mesh: Mesh | None = None  # None: one device
    peers: Peers | None = None  # None: one process

    @property
    def first(self) -> bool:
        """Whether this process logs and saves."""
        return self.peers is None or self.peers.index == 0

    @property
    def count(self) -> int:
        """How many devices share a batch."""
        return 1 if self.mesh is None else self.mesh.size

    @property
    def blocking(self) -> bool:
        """Whether each step is waited for: jax 0.10.2 hangs with several CPU devices in a process."""
        return self.mesh is not None and jax.default_backend() == "cpu" and jax.local_device_count() > 1

    def rows(self, size: int) -> slice:
        """Return which rows of a batch of `size` this process makes."""
        if self.peers is None:
            return slice(None)
        own = size // self.peers.count
        return slice(self.peers.index * own, (self.peers.index + 1) * own)

    def put(self, batch: Any, axes: Any) -> Any:
        """Return this process' rows as part of the global batch; `axes` says which axis of a leaf is split.

        `axes` is a tree of ints, of which `batch` may have subtrees in place of leaves.
        """
        if self.mesh is None:
            return batch
        return jax.tree.map(lambda axis, part: jax.tree.map(partial(self._split, axis), part), axes, batch)

    def _split(self, axis: int, leaf: Any) -> jax.Array:
        assert self.mesh is not None
        local = np.asarray(leaf)
        shape = list(local.shape)
        shape[axis] *= 1 if self.peers is None else self.peers.count
        sharding = NamedSharding(self.mesh, P(*[None] * axis, AXIS))
        return jax.make_array_from_process_local_data(sharding, local, tuple(shape))

    def spread(self, state: Any) -> Any:
        """Return process 0's state on all devices, lanes (what lies under `carry`) split over them."""
        if self.mesh is None:
            return state
        whole = jax.tree.map(lambda leaf: jax.random.key_data(leaf) if _is_key(leaf) else leaf, state)
        if self.peers is not None:
            whole = multihost_utils.broadcast_one_to_all(whole)

        def placed(sharding: NamedSharding, leaf: Any, like: Any) -> jax.Array:
            value = np.asarray(leaf)
            array = jax.make_array_from_callback(value.shape, sharding, lambda index: value[index])
            return jax.random.wrap_key_data(array, impl=jax.random.key_impl(like)) if _is_key(like) else array

        return jax.tree.map(placed, self._shardings(state), whole, state)

    def step(self, step_fn: Callable, state: Any) -> Callable:
        """Return `step_fn` (state, batch) -> (state, metrics) whose state stays where `spread` puts it."""
        if self.mesh is None:
            return step_fn
        results = (self._shardings(state), NamedSharding(self.mesh, P()))
        return jax.jit(step_fn, donate_argnums=0, out_shardings=results)

    def whole(self, state: Any) -> Any:
        """Return the whole state in each process, for a checkpoint; all processes call this together."""
        if self.mesh is None:
            return state
        return self.local(jax.jit(lambda state: state, out_shardings=NamedSharding(self.mesh, P()))(state))

    def local(self, tree: Any) -> Any:
        """Return arrays that all devices have, as arrays of one device of this process."""
        return tree if self.mesh is None else jax.tree.map(lambda leaf: leaf.addressable_data(0), tree)

    def of_first(self, value: Any) -> Any:
        """Return the `value` (of JSON) that process 0 has; all processes call this together."""
        return value if self.peers is None else self.peers.exchange(value)[0]

    def any(self, value: bool) -> bool:
        """Return whether any process has a true `value`; all processes call this together."""
        return value if self.peers is None else any(self.peers.exchange(value))

    def after_first(self, make: Callable[[], Any]) -> Any:
        """Return `make()`, which process 0 calls before the others: they find the files that it wrote."""
        if self.peers is None:
            return make()
        if self.first:
            made = make()
            self.peers.exchange(None)
            return made
        self.peers.exchange(None)
        return make()

    def made_step(self, *, more: bool) -> None:
        """Note that a step was made; with `more` the next has to come in time."""
        if self.peers is not None:
            self.peers.made_step(more=more)

    def check_batches(self, sizes: Mapping[str, int]) -> None:
        """Raise `ValueError` for a batch, by the configuration's key, that cannot be split evenly."""
        for key, size in sizes.items():
            if size % self.count:
                more = -(-size // self.count) * self.count
                raise ValueError(
                    f"{key} = {size} cannot be split over {self.count} devices; give --{key} a multiple of "
                    f"{self.count}, such as {more}, or use fewer devices."
                )

    def _shardings(self, state: Any) -> Any:
        assert self.mesh is not None
        mesh = self.mesh

        def sharding(path: tuple, _leaf: Any) -> NamedSharding:
            return NamedSharding(mesh, P(AXIS) if any(_name(key) == CARRY for key in path) else P())

        return jax.tree_util.tree_map_with_path(sharding, state)


ONE = Devices()


def _is_key(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array) and jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _name(key: Any) -> str:
    return getattr(key, "name", "")


def check_group(coordinator: str, processes: int | None, process: int | None) -> None:
    """Raise `ValueError` for options of a group by hand that do not go together."""
    given = {"--coordinator": coordinator or None, "--processes": processes, "--process": process}
    missing = [name for name, value in given.items() if value is None]
    if len(missing) == len(given):
        return
    if missing or processes is None or process is None:
        raise ValueError(
            f"{missing[0]} is missing; by hand give every process all of --coordinator HOST:PORT, "
            "--processes N and --process I."
        )
    host, _, port = coordinator.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 2**16:
        raise ValueError(f"--coordinator {coordinator} is no HOST:PORT; give it as in node1:12345.")
    if processes < 1:
        raise ValueError(f"--processes {processes} is no number of processes; give 1 or more.")
    if not 0 <= process < processes:
        raise ValueError(f"--process {process} is none of {processes}; give 0 to {processes - 1}.")


@contextmanager
def all_devices(
    coordinator: str = "", processes: int | None = None, process: int | None = None
) -> Iterator[Devices]:
    """Give all devices of all processes that a cluster's launcher, or the arguments, name.

    To be entered before JAX computes anything. The processes end together: an error in one of them ends the
    others with its sentence. All but process 0 are silent otherwise. Raises `ValueError` for arguments or a
    launcher that do not name a group.
    """
    _start(coordinator, processes, process)
    many = jax.process_count() > 1
    peers = _meet() if many else None
    ordered = sorted(jax.devices(), key=lambda device: (device.process_index, device.id))
    mesh = jax.make_mesh((len(ordered),), (AXIS,), axis_types=(AxisType.Auto,), devices=ordered)
    devices = Devices(mesh if len(ordered) > 1 else None, peers)
    if peers is None:
        yield devices
        return
    with _one_end(peers), nullcontext() if devices.first else _silence():
        yield devices
    peers.close()
    jax.distributed.shutdown()


@contextmanager
def _silence() -> Iterator[None]:
    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stderr(nowhere):
        yield


@contextmanager
def _one_end(peers: Peers) -> Iterator[None]:
    """End all processes with an error of one of them; a stop, which all make together, passes."""
    try:
        yield
    except SystemExit:
        peers.close()
        jax.distributed.shutdown()
        raise
    except BaseException as error:
        threading.Event().wait(_COLLATERAL)  # the end of another process ends this one meanwhile
        code, sentence = _INTERRUPTED, "interrupted; the same command for all processes goes on"
        if isinstance(error, ValueError | OSError):
            code, sentence = _REFUSED, str(error)
        elif isinstance(error, Exception):
            traceback.print_exc()
            code = _FAULT
            sentence = f"{type(error).__name__}, a fault of garment-jax; please report the lines above."
        where = f"process {peers.index} on {socket.gethostname()}: " if peers.index else ""
        peers.end_all(code, where + sentence)
        raise


def _start(coordinator: str, processes: int | None, process: int | None) -> None:
    """Start JAX's runtime over processes, where there are several."""
    check_group(coordinator, processes, process)
    index = os.environ.get("JOB_COMPLETION_INDEX")  # of a Kubernetes Job
    if not coordinator and index and find_spec("kubernetes") is None:
        raise ValueError(
            f"this is pod {index} of a Kubernetes Job, and the package kubernetes, by which JAX finds the "
            "others, is missing; pip install kubernetes, or give --coordinator, --processes and --process."
        )
    jax.config.update("jax_enable_preemption_service", False)  # SIGTERM is ours: the stages save and stop
    late = threading.Timer(COMING, _say_late, [coordinator])
    late.daemon = True
    late.start()
    try:
        jax.distributed.initialize(
            coordinator or None,
            processes,
            process,
            cluster_detection_method="deactivate" if coordinator else None,
            initialization_timeout=2 * COMING,
        )
    except ValueError as error:
        if "coordinator_address should be defined" not in str(error):
            raise ValueError(
                f"the processes of this training were not found ({error}); give --coordinator, --processes "
                "and --process."
            ) from error
        # no cluster: all devices of this machine
    except RuntimeError as error:
        raise ValueError(
            f"the processes of this training did not meet ({str(error).splitlines()[0]}); see that process 0 "
            "runs where --coordinator says, with that port free."
        ) from error
    finally:
        late.cancel()


def _say_late(coordinator: str) -> None:
    where = f" at {coordinator}" if coordinator else ""
    # JAX would abort with a stack trace
    end_process(
        LOST, f"not all processes came{where} within {COMING} s; start as many as there are to be, together."
    )


def _meet() -> Peers:
    from jax._src.distributed import global_state  # the only place that knows where process 0 is

    host = str(global_state.coordinator_address).rpartition(":")[0].strip("[]")

    def share(value: bytes) -> bytes:
        whole = multihost_utils.broadcast_one_to_all(np.frombuffer(value, np.uint8))
        return np.asarray(whole).tobytes()

    try:
        with _no_output():  # Gloo greets on standard output
            return connect(jax.process_index(), jax.process_count(), host, share)
    except OSError as error:
        end_process(_REFUSED, str(error))  # else JAX would wait for the others once more


@contextmanager
def _no_output() -> Iterator[None]:
    """Let nothing through to standard output, of other languages' code neither."""
    sys.stdout.flush()
    output = os.dup(1)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        os.dup2(output, 1)
        os.close(output)
