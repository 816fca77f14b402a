"""The processes of one training: found by a launcher or by hand, started together, ended together."""

import os
import socket
import sys
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, redirect_stderr, suppress
from importlib.util import find_spec

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import AxisType

from garment_jax.training.devices import AXIS, Devices
from garment_jax.training.peers import LOST, Peers, connect, end_process

COMING = 300  # seconds that processes are waited for at the start
JOB, MPI = "JOB_COMPLETION_INDEX", ("OMPI_COMM_WORLD_RANK", "PMI_RANK")  # set by launchers
_BY_HAND = "every process --coordinator HOST:PORT, --processes N and --process I"
_REFUSED, _FAULT, _INTERRUPTED = 2, 70, 130  # exit codes, as `garment_jax.cli` has them
_COLLATERAL = 3.0  # seconds within which the end of another process explains an error here


def check_group(coordinator: str, processes: int | None, process: int | None) -> None:
    """Raise `ValueError` for options of a group by hand that do not go together."""
    given = {"--coordinator": coordinator or None, "--processes": processes, "--process": process}
    missing = [name for name, value in given.items() if value is None]
    if len(missing) == len(given):
        return
    if missing or processes is None or process is None:
        raise ValueError(f"{missing[0]} is missing; by hand give {_BY_HAND}.")
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
        if "Gloo" in str(error) or "NCCL" in str(error):
            code, sentence = LOST, f"the connection to another process broke ({error})"
        elif isinstance(error, ValueError | OSError):
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
    method = "deactivate" if coordinator else _launcher(os.environ)
    with suppress(AttributeError):  # a setting that later versions may drop
        jax.config.update("jax_enable_preemption_service", False)  # SIGTERM is ours: stages save and stop
    late = threading.Timer(COMING, _say_late, [coordinator])
    late.daemon = True
    late.start()
    try:
        jax.distributed.initialize(
            coordinator or None,
            processes,
            process,
            cluster_detection_method=method,
            initialization_timeout=2 * COMING,
        )
    except ValueError as error:
        if "coordinator_address should be defined" not in str(error):
            raise ValueError(
                f"the processes of this training were not found ({error}); give {_BY_HAND}."
            ) from error
        # no cluster: all devices of this machine
    except RuntimeError as error:
        raise ValueError(
            f"the processes of this training did not meet ({str(error).splitlines()[0]}); see that process 0 "
            "runs where --coordinator says, with that port free."
        ) from error
    finally:
        late.cancel()


def _launcher(environment: Mapping[str, str]) -> str | None:
    """Return which launcher's processes JAX is to look for; None leaves it to JAX.

    Raises `ValueError` where there are others that JAX could not find: each would train alone.
    """
    found = [(JOB, "pod", "a Kubernetes Job", "kubernetes")] if JOB in environment else []
    if "OMPI_MCA_orte_hnp_uri" not in environment:  # of Open MPI 4, which JAX knows
        ranks = [name for name in MPI if name in environment]
        found += [(name, "process", "mpirun", "mpi4py") for name in ranks[:1]]
    for name, what, launcher, package in found:
        if find_spec(package) is None:
            raise ValueError(
                f"this is {what} {environment[name]} of {launcher}, and the package {package}, by which JAX "
                f"finds the others, is missing; pip install {package}, or give {_BY_HAND}."
            )
    return "mpi4py" if found and found[0][-1] == "mpi4py" else None


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
