"""Parts of the jobs: apart, together all, and refused in a sentence."""

import pytest

from garment_jax.farm.shard import Shard, parse_shard


@pytest.mark.parametrize("count", [1, 2, 3, 7, 16, 40])
def test_the_parts_are_apart_and_together_all(count: int) -> None:
    jobs = list(range(23))
    parts = [parse_shard(f"{k}/{count}").of(jobs) for k in range(1, count + 1)]
    assert sorted(job for part in parts for job in part) == jobs
    assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_a_part_is_read_and_written() -> None:
    assert parse_shard("3/16") == Shard(3, 16)
    assert str(Shard(3, 16)) == "3/16"


@pytest.mark.parametrize(
    "text", ["0/4", "5/4", "3", "3/0", "-1/4", "a/b", "", "1/2/3", "1.5/2", "9999999999/1"]
)
def test_what_is_no_part_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"is no part; give NUMBER/COUNT"):
        parse_shard(text)
