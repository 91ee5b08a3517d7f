"""Checks of base parameters and payloads: the torques that they cause are compared with those of the reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rrrgen.verify.comparison import Collector, Tolerances
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, centre_and_tensor
from rrrgen.verify.subject import States, random_parameters

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model


def check_parameters(
    model: Model, ne: NewtonEuler, s: States, rng: np.random.Generator, tolerances: Tolerances, rows: Collector
) -> None:
    """Compare the torques of random link parameters, and those that random payloads add, at the states ``s``."""
    check = rows.against(ne.name, "-", tolerances.exact, s.count)
    Y, n = ne.standard_regressor(s.q, s.dq, s.ddq), ne.chain.links
    phi = np.stack([random_parameters(n, rng).ravel() for _ in range(s.count)])

    def torques(beta: Array) -> Array:
        return np.asarray(np.einsum("nij,nj->ni", model.regressor(s.q, s.dq, s.ddq), beta))

    check("base_parameters", lambda: torques(model.base_parameters_of(phi)), np.einsum("nij,nj->ni", Y, phi))
    bodies = random_parameters(s.count, rng)
    added = np.einsum("nij,nj->ni", Y[:, :, 10 * ne.chain.tip : 10 * ne.chain.tip + 10], bodies)
    mass = bodies[:, 0]
    centres = [centre_and_tensor(row) for row in bodies]
    com, tensors = (np.stack(part) for part in zip(*centres, strict=True))
    R, p = np.stack([_rotation(rng) for _ in range(s.count)]), rng.uniform(-0.3, 0.3, (s.count, 3))
    frame = np.zeros((s.count, 4, 4))
    frame[:, :3, :3], frame[:, :3, 3], frame[:, 3, 3] = R, p, 1.0
    own_com = np.einsum("nji,nj->ni", R, com - p)
    own_tensors = np.einsum("nki,nkl,nlj->nij", R, tensors, R)

    def bare() -> Array:
        return np.asarray(model.base_parameters_of(np.zeros((s.count, 10 * n)))[0])

    check("add_payload", lambda: torques(model.add_payload(mass, com, tensors, beta=bare())), added)
    check(
        "add_payload_at",
        lambda: torques(model.add_payload_at(mass, own_com, own_tensors, frame, beta=bare())),
        added,
    )


def _rotation(rng: np.random.Generator) -> Array:
    """Draw a random rotation matrix (3, 3)."""
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(Q * np.sign(np.linalg.det(Q)))
