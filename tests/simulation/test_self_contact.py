"""Self-contact of many clips at once against Newton's own of one."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from garment_jax.simulation.settings import ClothSettings
from tests.reference.scene import make_scene

pytest.importorskip("newton")
import newton

from garment_jax.simulation.engine import wp
from garment_jax.simulation.newton_cloth import make_solver
from garment_jax.simulation.self_contact import ROWS, SelfContact

SCENE = make_scene(8, 24)
N = len(SCENE.garment.template)
SETTINGS = ClothSettings(self_collision=True, self_collision_radius=5e-3)
DEVICES = ["cpu", *(device.alias for device in wp.get_devices() if device.is_cuda)]
HALF = 2.0


def crumpled(seed: int, at: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Cloth that lies in itself in many places."""
    noise = np.random.default_rng(seed).normal(0.0, 0.015, (N, 3))
    squeezed = SCENE.garment.template * [0.6, 0.9, 0.6]
    return (squeezed + noise + np.asarray(at)).astype(np.float32)


def newtons(cloth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces [n, 3] and their stiffness [n, 3, 3] by Newton's own class, three kernels of it."""
    with wp.ScopedDevice("cpu"):
        solver = make_solver(SCENE.garment, SETTINGS, None)
        collision, model = solver.collision, solver.model
        x, stiff = wp.array(cloth, dtype=wp.vec3), wp.array(diagonal(solver), dtype=float)
        type(collision).frame_begin(collision, x, x, 0.0)  # the solver's own does nothing
        for near in (collision.broad_phase_vf, collision.broad_phase_ee, collision.broad_phase_ef):
            assert near.numpy()[0].max() < ROWS - 1  # in a full list it would be chance what is in it
        collision.body_contact_max = 0
        forces = wp.zeros(N, dtype=wp.vec3)
        state = model.state()
        state.particle_q.assign(x)
        contacts = newton.Contacts(0, 0, device="cpu")
        collision.accumulate_contact_force(0.0, 0, state, state, contacts, forces, x, stiff)
    return forces.numpy().copy(), collision.contact_hessian_diags.numpy().copy()


def diagonal(solver: Any) -> np.ndarray:
    return np.linspace(1.0, 3.0, len(solver.model.particle_mass)).astype(np.float32)


def ours(cloths: list[np.ndarray], roots: np.ndarray, device: str) -> tuple[np.ndarray, np.ndarray]:
    clips = len(cloths)
    with wp.ScopedDevice("cpu"):
        solver = make_solver(SCENE.garment, SETTINGS, None)
    with wp.ScopedDevice(device):
        cell = wp.array(5.0 * np.arange(clips)[:, None] * np.ones(3), dtype=wp.vec3)
        root = wp.array(np.stack([roots - 1.0, roots + 3.0]), dtype=wp.vec3)
        x = wp.array(np.stack(cloths), dtype=wp.vec3)
        forces, contact = wp.zeros(clips * N, dtype=wp.vec3), wp.zeros(clips * N, dtype=wp.mat33)
        found = SelfContact(solver, diagonal(solver), clips, cell, HALF, wp.get_device(device))
        for _ in range(2):  # trees are made, then refitted
            found.find(0.25, root, x)
        found.push(x.flatten(), forces, contact)
    return forces.numpy().reshape(clips, N, 3), contact.numpy().reshape(clips, N, 3, 3)


@pytest.mark.parametrize("device", DEVICES)
def test_forces_of_each_clip_are_newtons_wherever_it_is_and_whoever_is_in_the_same_place(device: str):
    roots = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [8.0, 1.0, -3.0]])
    cloths = [crumpled(0), crumpled(1), crumpled(2, roots[2])]
    forces, contact = ours(cloths, roots, device)
    for i, cloth in enumerate(cloths):
        wanted, stiffness = newtons(cloth)
        assert (np.abs(wanted).max(axis=1) > 0).mean() > 0.2
        np.testing.assert_allclose(forces[i], wanted, atol=2e-4 * np.abs(wanted).max())
        np.testing.assert_allclose(contact[i], stiffness, atol=2e-4 * np.abs(stiffness).max())


@pytest.mark.parametrize("device", DEVICES)
def test_cloth_that_is_lost_pushes_no_other(device: str):
    roots = np.zeros((3, 3))
    alone, _ = ours([crumpled(0)], roots[:1], device)
    lost, far = crumpled(1), crumpled(2)
    lost[5] = np.nan
    far[3] = [5.0, 5.0, 5.0]  # in the world where the second clip's cell is
    forces, _ = ours([crumpled(0), lost, far], roots, device)
    np.testing.assert_allclose(forces[0], alone[0], atol=1e-5 * np.abs(alone).max())
    assert np.isfinite(forces[2]).all()
