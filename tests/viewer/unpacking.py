"""A second reader of the page's data, written from `docs/viewer.md` with plain loops."""

import base64
import json
import re
import zlib
from pathlib import Path

import numpy as np


def read_page(path: Path) -> tuple[dict, dict[str, bytes]]:
    """Return the page's facts and its inflated blocks by id."""
    text = path.read_text(encoding="utf-8")
    facts = re.search(r'<script type="application/json" id="facts">(.*?)</script>', text)
    assert facts is not None
    blocks = re.findall(r'<script type="text/plain" id="(.*?)">(.*?)</script>', text)
    return json.loads(facts[1]), {name: zlib.decompress(base64.b64decode(data)) for name, data in blocks}


def unpack_chunk(data: bytes, order: np.ndarray, parent: np.ndarray) -> np.ndarray:
    """Return steps `[k, n, 3]` of one inflated chunk, in whole numbers that wrap at 16 bits."""
    n, half = len(order), len(data) // 2
    frames = half // (3 * n)
    steps = np.zeros((frames, n, 3), np.int64)
    at = 0
    for axis in range(3):
        change = np.zeros((frames, n), np.int64)
        for f in range(frames):
            for rank in range(n):
                folded = data[at] + 256 * data[half + at]
                change[f, rank] = folded // 2 if folded % 2 == 0 else -(folded + 1) // 2
                at += 1
            if f == 1:
                change[f] += change[0]
            elif f > 1:
                change[f] += 2 * change[f - 1] - change[f - 2]
            for rank in range(n):
                before = steps[f, order[parent[rank]], axis] if parent[rank] >= 0 else 0
                steps[f, order[rank], axis] = change[f, rank] + before
    return (steps + 32_768) % 65_536 - 32_768


def unpack_sequence(facts: dict, blocks: dict[str, bytes], index: int) -> np.ndarray:
    """Return positions `[t, n, 3]` in metres from the root."""
    order, parent = (np.frombuffer(blocks[facts[name]], "<i4") for name in ("order", "parent"))
    chunks = [unpack_chunk(blocks[name], order, parent) for name in facts["sequences"][index]["chunks"]]
    return np.concatenate(chunks) * facts["step"]
