"""Training over several devices and processes: a mesh with one axis of data, parameters on all of them.

Every process draws the whole batch's frames from seed and step and makes its own rows, so that N processes
see what one would; XLA's partitioner reduces gradients and metrics. Not in the paper.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jax.experimental import multihost_utils
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from garment_jax.training.peers import Peers

AXIS = "data"
CARRY = "carry"  # the field of a state whose leaves are lanes


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
        return self.local(jax.jit(_same, out_shardings=NamedSharding(self.mesh, P()))(state))

    def local(self, tree: Any) -> Any:
        """Return arrays that all devices have, as arrays of one device of this process."""
        return tree if self.mesh is None else jax.tree.map(lambda leaf: leaf.addressable_data(0), tree)

    def of_first(self, value: Any) -> Any:
        """Return the `value` (of JSON) that process 0 has; all processes call this together."""
        return value if self.peers is None else self.peers.exchange(value)[0]

    def check_same(self, what: str, value: Any) -> None:
        """Raise `ValueError` where `value` (of JSON) is not what process 0 has; all call this together."""
        if self.of_first(value) != value:
            raise ValueError(f"{what} is not that of process 0; give all processes the same.")

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


def _same(state: Any) -> Any:  # by a name, so that it is compiled once
    return state


def _is_key(leaf: Any) -> bool:
    return isinstance(leaf, jax.Array) and jax.numpy.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _name(key: Any) -> str:
    return getattr(key, "name", "")
