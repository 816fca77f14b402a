"""Which functions a frame of collision handling goes to, by sampling the compiled program (Linux, `perf`).

    python benchmarks/kernels.py SEQUENCE.h5 [--solver-alone] [--whole-body] [--vertices N] [--frames 192]
        [--seconds 10] [--json FILE]

The sequence, and the options, are those of `benchmarks/collision.py`. A tracer that notes the begin and the
end of every operation takes longer than most of them; samples of the processor's place cost nothing. XLA
writes each kernel's code into a file, where it lies in memory is found by its bytes, and the program's text
says which function of ours (`geometry/noinline.py`) it belongs to. Microseconds are a function's share of the
samples of the frame's time, which is measured without them; a function's copies in the program count as one,
and of kernels with the same code any may be named. "runtime" is XLA's own: starting
kernels, matrix products, minima; "other" the C library and the kernel.
"""

import argparse
import bisect
import os
import re
import shutil
import struct
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import collision
import jax

from garment_jax.bench.figures import report

STRETCH = 64  # frames a call
WINDOW = 24  # bytes of a kernel that are looked for; between two of them may lie an address that was put in
RATE = 8000  # samples a second


class Kernel(NamedTuple):
    """A function in an object file."""

    name: str
    code: bytes


def kernels(path: Path) -> list[Kernel]:
    """Return the functions of an ELF object file (64 bits, little-endian)."""
    data = path.read_bytes()
    at, width, count = *struct.unpack_from("<Q", data, 40), *struct.unpack_from("<HH", data, 58)
    sections = [struct.unpack_from("<IIQQQQIIQQ", data, at + k * width) for k in range(count)]
    found = []
    for _, kind, _, _, start, size, link, _, _, each in sections:
        if kind != 2:  # a table of symbols
            continue
        names = sections[link][4]
        for k in range(start, start + size, each):
            name, info, _, section, value, length = struct.unpack_from("<IBBHQQ", data, k)
            if info & 15 == 2 and 0 < section < count:  # a function that is defined here
                spelt = data[names + name : data.index(b"\0", names + name)].decode()
                code = sections[section][4] + value
                found.append(Kernel(spelt, data[code : code + length]))
    return found


def functions(text: str) -> dict[str, str]:
    """Return which function of ours each instruction of a program's text belongs to."""
    within, found = "", {}
    for line in text.splitlines():
        if opened := re.match(r"(?:ENTRY )?%?([\w.\-]+) \(.*\{\s*$", line):
            within = opened.group(1)
        elif within.startswith(("fused_", "wrapped_")):
            continue
        elif named := re.match(r"\s+(?:ROOT )?%?([\w.\-]+) = ", line):
            found[named.group(1)] = re.sub(r"(_\d+)?(\.\d+)?$", "", within)
    return found


def code_in_memory() -> Iterator[tuple[int, bytes]]:
    """Yield the places and bytes of this process' code that comes from no file."""
    with open("/proc/self/maps") as maps, open("/proc/self/mem", "rb", 0) as memory:
        for line in maps:
            where, rights, *_, last = line.split()
            if "x" in rights and last == "0":  # the number of a file; where there is one its name comes last
                start, end = (int(x, 16) for x in where.split("-"))
                memory.seek(start)
                yield start, memory.read(end - start)


def located(every: list[Kernel], pieces: list[tuple[int, bytes]]) -> dict[int, Kernel]:
    """Return the kernels by where they are in memory; those that cannot be found are left out."""
    found: dict[int, Kernel] = {}
    for kernel in every:
        for start in range(0, max(len(kernel.code) - WINDOW, 1), WINDOW // 2):
            window = kernel.code[start : start + WINDOW]
            hits = [
                at + match.start() - start
                for at, code in pieces
                for match in re.finditer(re.escape(window), code)
            ]
            hits = [hit for hit in hits if hit % 16 == 0 and hit not in found]
            if len(window) == WINDOW and hits and (len(hits) == 1 or start >= 2 * WINDOW):
                found[hits[0]] = kernel  # of several that look the same, any: they are copies
                break
    return found


def sampled(call, seconds: float, folder: Path) -> list[tuple[int, str]]:
    """Return the address and the file of each sample while `call` runs again and again."""
    data = folder / "perf.data"
    command = [
        "perf",
        "record",
        "-q",
        "-e",
        "cpu-clock",
        "-F",
        str(RATE),
        "-o",
        str(data),
        "-p",
        str(os.getpid()),
    ]
    recorder = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    time.sleep(0.5)  # until it has begun
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        call()
    recorder.terminate()
    recorder.wait()
    if not data.exists() or not data.stat().st_size:
        raise SystemExit(
            "perf recorded nothing; see what `perf record -p` says (kernel.perf_event_paranoid)."
        )
    script = ["perf", "script", "-i", str(data), "-F", "ip,sym,dso"]
    lines = subprocess.run(script, capture_output=True, text=True, check=True).stdout.splitlines()
    places = (re.match(r"\s*([0-9a-f]+).*\((.*?)\)$", line) for line in lines)
    return [(int(place.group(1), 16), place.group(2)) for place in places if place]


def shares(
    samples: list[tuple[int, str]], found: dict[int, Kernel], names: dict[str, str]
) -> dict[str, float]:
    """Return each function's part of the samples, the greatest first."""
    starts, counts = sorted(found), Counter()
    for address, file in samples:
        k = bisect.bisect_right(starts, address) - 1
        if k >= 0 and address < starts[k] + len(found[starts[k]].code):
            counts[names.get(found[starts[k]].name, "?")] += 1
        else:
            counts["runtime" if "jax" in Path(file).name else "other"] += 1
    return {name: count / len(samples) for name, count in counts.most_common()}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("sequence", type=Path)
    parser.add_argument(
        "--frames", type=int, default=3 * STRETCH, help="of the sequence; the first call is not timed"
    )
    parser.add_argument("--solver-alone", action="store_true", help="neither limbs nor shortening")
    parser.add_argument("--whole-body", action="store_true")
    parser.add_argument("--vertices", type=int, help="of the garment, no fewer than it has")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long to sample")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if not shutil.which("perf"):
        raise SystemExit("perf is not to be found; install linux-perf (Debian) or linux-tools (Ubuntu).")
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        dump = f"--xla_dump_to={folder} --xla_dump_hlo_module_re=jit_run"
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {dump}"
        jax.config.update("jax_enable_compilation_cache", False)  # what is only read back is not written
        clip = collision.read(options.sequence, options)
        calls = collision.calls_of(clip, STRETCH)
        if len(calls) < 2:
            raise SystemExit(f"{len(clip.frames[0])} frames to resolve; give {2 * STRETCH} or more.")
        resolve, carry = collision.begun(clip)
        ready = []
        for call in calls:
            ready.append((carry, call))
            carry = jax.block_until_ready(resolve(carry, *call))[0]

        def again() -> float:
            began = time.perf_counter()
            for carry, call in ready[1:]:
                jax.block_until_ready(resolve(carry, *call))
            return 1e6 * (time.perf_counter() - began) / STRETCH / len(ready[1:])

        frame_us = min(again() for _ in range(10))
        text = next(folder.glob("*jit_run*after_optimizations.txt")).read_text()
        every = [kernel for path in sorted(folder.glob("*jit_run*.o")) for kernel in kernels(path)]
        found = located(every, list(code_in_memory()))
        parts = shares(sampled(again, options.seconds, folder), found, functions(text))
    rows = [{"function": name, "us": frame_us * part, "share": part} for name, part in parts.items()]
    facts = {"frame_us": frame_us, "kernels": len(every), "found": len(found)}
    report(rows, title=f"where a frame of {options.sequence.stem} goes", facts=facts, json_path=options.json)


if __name__ == "__main__":
    main()
