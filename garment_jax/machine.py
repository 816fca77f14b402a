"""The machine that we run on: processor, memory, versions, date. No figure is worth anything without them."""

import datetime
import os
import platform
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = ("jax", "jaxlib", "flax", "optax", "numpy", "scipy")


def machine() -> dict[str, str]:
    """Return processor, cores, memory, load, device, versions and date."""
    import jax  # here: `process_age` is asked before it is loaded

    device = jax.devices()[0]
    return {
        "processor": processor(),
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        "memory": _line("/proc/meminfo", "MemTotal") or "unknown",
        "load": f"{os.getloadavg()[0]:.1f}",
        "device": f"{device.platform} {device.device_kind}",
        "system": platform.system(),
        "python": platform.python_version(),
        "garment-jax": _version("garment-jax"),
        **{name: _version(name) for name in PACKAGES},
        "date": datetime.datetime.now().astimezone().isoformat(timespec="minutes"),
    }


def absent_device() -> str:
    """Return a sentence where `JAX_PLATFORMS` names a device that a loaded JAX does not find here."""
    named, jax = os.environ.get("JAX_PLATFORMS", ""), sys.modules.get("jax")
    if not named or jax is None:
        return ""
    try:
        jax.devices()
    except Exception:  # of several kinds
        return f"JAX_PLATFORMS={named} names a device that is not here; unset it, or set it to cpu."
    return ""


def processor() -> str:
    """Return the processor's name."""
    return _line("/proc/cpuinfo", "model name") or platform.processor() or platform.machine()


def processor_flags() -> str:
    """Return the processor's abilities, where the system tells: a program made for others may not run."""
    return _line("/proc/cpuinfo", "flags")


def _line(file: str, key: str) -> str:
    path = Path(file)
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    found = [line.split(":", 1)[1].strip() for line in lines if line.startswith(key)]
    return found[0] if found else ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def peak_mb() -> float:
    """Return the most memory that this process has held, MB."""
    import resource  # Windows has no such module

    unit = 1 if sys.platform == "darwin" else 1024  # bytes of what the system counts in
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def process_age() -> float | None:
    """Return the seconds since this process began, None where the system does not say."""
    stat = Path("/proc/self/stat")
    if not stat.exists():
        return None
    ticks = int(stat.read_text(encoding="utf-8").rpartition(")")[2].split()[19])
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
