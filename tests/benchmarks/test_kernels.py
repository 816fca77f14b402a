import pytest

from tests.benchmarks.scripts import script

kernels = script("kernels")

TEXT = """
%fused_computation.3 (x: f32[8]) -> f32[8] {
  %inner_add = f32[8]{0} add(%x, %x)
}

%_placed_12.7 (x: f32[8]) -> f32[8] {
  %x = f32[8]{0} parameter(0)
  ROOT %add_fusion.3 = f32[8]{0} fusion(%x), kind=kLoop, calls=%fused_computation.3
}

ENTRY %main.9 (x: f32[8]) -> f32[8] {
  %wrapped_copy = f32[8]{0} fusion(%x), kind=kLoop
}
"""


def test_an_instruction_belongs_to_the_function_around_it_without_its_number():
    found = kernels.functions(TEXT)
    assert found["add_fusion.3"] == "_placed"
    assert found["wrapped_copy"] == "main"
    assert "inner_add" not in found  # part of a kernel, not one


def test_kernels_are_found_by_their_bytes_whatever_address_was_put_in():
    first, second = bytes(range(100)), bytes(range(100, 180))
    put_in = first[:30] + b"\xff" * 8 + first[38:]  # as when it is loaded
    memory = b"\0" * 64 + put_in + b"\0" * 12 + second
    every = [kernels.Kernel("a", first), kernels.Kernel("b", second), kernels.Kernel("c", b"\x77" * 50)]
    found = kernels.located(every, [(4096, memory)])
    assert {at: kernel.name for at, kernel in found.items()} == {4160: "a", 4272: "b"}


def test_samples_count_for_their_function_for_the_runtime_or_for_others():
    found = {4160: kernels.Kernel("add_fusion.3", b"\0" * 100), 4272: kernels.Kernel("copy", b"\0" * 80)}
    samples = [(4160, ""), (4259, ""), (4300, ""), (4260, "/lib/libjax_common.so"), (9000, "/lib/libc.so.6")]
    parts = kernels.shares(samples, found, {"add_fusion.3": "_placed", "copy": "_placed"})
    assert parts == pytest.approx({"_placed": 0.6, "runtime": 0.2, "other": 0.2})
    assert next(iter(parts)) == "_placed"
