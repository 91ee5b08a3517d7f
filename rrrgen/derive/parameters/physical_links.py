"""Physically consistent links with given base parameters: ``K phi = beta``, every pseudo-inertia P_j positive definite.

Torques determine only the base parameters beta (b,), but simulators need the mass, centre of mass and inertia of each
link: the standard parameters phi. All ``phi = L beta + N x`` have these base parameters and hence the same dynamics (L
is a right inverse of K, N a basis of its null space). Of these, the one nearest to a prior P0_j of uniform bodies is
taken: it maximizes ``sum_j log det P_j - tr(P0_j^-1 P_j)``, which minimizes the entropic divergence of Lee, Wensing and
Park (2020).
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError, require
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.robot.spec import RobotSpec, link_of, standard_parameters

SMALLEST = 1e-9  # of the largest eigenvalue of a pseudo-inertia: below it MuJoCo refuses the body
DEFAULT_STRENGTH = 1.0
"""Weight lambda of the prior: per link, that of one observation with the standard deviation of the noise."""
SMALLEST_LENGTH = 0.05  # m, assumed for the prior of a link without length
TYPICAL_TORQUE = 10.0  # N m; sets the scale of the prior where the file has no links


@dataclass(frozen=True)
class Prior:
    """Prior pseudo-inertias ``P0`` (n, 4, 4), positive definite, and the weight ``strength`` of the prior.

    Raises :class:`InputError` if a pseudo-inertia is not positive definite or the weight is not positive.
    """

    P0: Array
    strength: float = DEFAULT_STRENGTH

    def __post_init__(self) -> None:
        if self.strength <= 0:
            raise InputError(f"the weight of the prior is {self.strength:g}; it must be positive")
        if np.any(np.linalg.eigvalsh(self.P0) <= 0):
            raise InputError("the prior of a link is not positive definite: its mass or inertia cannot be real")


def default_prior(spec: Any, torque_rms: float, strength: float = DEFAULT_STRENGTH) -> Prior:
    """Prior from the robot file ``spec``: its links if they are physical, otherwise spheres at the link origins.

    Without links, each of the n links has the mass ``m0 = tau_rms / (g L n)``, where ``torque_rms`` (N m) is the RMS
    torque, g the gravity and L the reach; its radius of gyration is a third of the link length from the
    Denavit-Hartenberg table. ``strength`` is the weight of the prior.
    """
    n = len(spec.rows)
    if spec.links is not None:
        phi = np.array([standard_parameters(link) for link in spec.links], float)
        P0 = pseudo_inertia(phi)
        if np.all(np.linalg.eigvalsh(P0) > 0):
            return Prior(P0, strength)
    lengths = link_lengths(spec)
    gravity = max(1.0, float(np.linalg.norm([float(g) for g in spec.gravity])))
    mass = max(torque_rms / (gravity * max(float(np.sum(lengths)), SMALLEST_LENGTH) * n), 1e-3)
    radius = lengths / 3.0
    return Prior(np.stack([mass * np.diag([r * r, r * r, r * r, 1.0]) for r in radius]), strength)


def link_lengths(spec: Any) -> Array:
    """Length (n,) of every link, m: the largest of ``|a|`` and ``|d|`` in its own and the next DH row, 5 cm or more."""
    sizes = [max(abs(a), abs(d)) for _, _, a, d, _ in spec.dh_table()]
    after = [*sizes[1:], 0.0]
    return np.maximum(SMALLEST_LENGTH, np.maximum(sizes, after))


def pseudo_inertia(phi: Array) -> Array:
    """Pseudo-inertia ``J = int [x y z 1]' [x y z 1] dm`` (..., 4, 4) of standard parameters ``phi`` (..., 10), (14.9).

    Products of inertia are tensor entries, ``Ixy = -int x y dm``; kg, kg m, kg m^2 about the link origin.
    """
    m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz = np.moveaxis(np.asarray(phi, float), -1, 0)
    half = 0.5 * (Ixx + Iyy + Izz)
    rows = [
        [half - Ixx, -Ixy, -Ixz, mx],
        [-Ixy, half - Iyy, -Iyz, my],
        [-Ixz, -Iyz, half - Izz, mz],
        [mx, my, mz, m],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def with_physical_links(spec: RobotSpec, beta: Mapping[str, float] | None) -> tuple[RobotSpec, tuple[str, ...]]:
    """Replace the links of ``spec`` by physically consistent ones; also returns notes on what was changed.

    The links have the base parameters of ``spec`` or, if given, ``beta`` (name -> value, SI units).
    Raises :class:`InputError` for names of ``beta`` that are not the robot's base parameters, and
    :class:`DerivationError` if there are no inertial parameters, or no physical links with these base parameters.
    """
    if beta is None:
        if spec.links is None:
            hint = "give them with --beta FILE (JSON, name: value; the names are those of 'rrrgen show')"
            raise DerivationError(f"{spec.name} has no links, and bodies need inertia: {hint}")
        phi = np.array([standard_parameters(link) for link in spec.links], float)
        if _are_bodies(pseudo_inertia(phi)):
            return spec, ()
    from rrrgen.derive import derive

    model = derive(spec)
    K = np.array(model.base_projection, dtype=float)
    names = [parameter.name for parameter in model.base_parameters]
    values = K @ phi.ravel() if beta is None else _values(beta, names)
    bodies = _bodies(K, values, default_prior(replace(spec, links=None), TYPICAL_TORQUE).P0)
    reason = "links that are no bodies have been replaced by" if beta is None else "the base parameters were given to"
    note = f"{reason} bodies with the same {len(names)} base parameters, hence the same dynamics"
    return replace(spec, links=tuple(link_of(row) for row in bodies)), (note,)


def _are_bodies(P: Array) -> bool:
    values = np.linalg.eigvalsh(P)
    return bool(np.all(values[:, 0] > SMALLEST * values[:, -1]) and np.all(values[:, -1] > 0))


def _values(beta: Mapping[str, float], names: list[str]) -> Array:
    unknown = [name for name in beta if name not in names]
    missing = [name for name in names if name not in beta]
    if unknown:
        hint = did_you_mean(unknown[0], names) or f"they are {', '.join(names)}"
        raise InputError(f"'{unknown[0]}' is no base parameter of the robot: {hint}")
    if missing:
        raise InputError(f"no value for the base parameters {', '.join(missing)}")
    return np.array([beta[name] for name in names])


def _bodies(K: Array, beta: Array, P0: Array) -> Array:
    """Standard parameters phi (n, 10) nearest to the prior ``P0``, with ``K phi = beta`` and physically consistent."""
    require("finding bodies with given base parameters", "cvxpy", "clarabel")
    cp: Any = import_module("cvxpy")

    n = len(P0)
    start = np.linalg.lstsq(K, beta, rcond=None)[0]
    null = np.linalg.svd(K)[2][len(K) :].T
    x = cp.Variable(null.shape[1])
    phi = start + null @ x
    at_zero = pseudo_inertia(np.zeros(10))
    entries = np.stack([pseudo_inertia(unit) - at_zero for unit in np.eye(10)])
    value: Any = 0
    for j in range(n):
        P = sum(phi[10 * j + k] * entries[k] for k in range(10))
        scale = np.linalg.inv(np.linalg.cholesky(P0[j]))
        scaled = scale @ P @ scale.T
        value += cp.log_det(scaled) - cp.trace(scaled)
    with contextlib.suppress(cp.error.SolverError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an inaccurate solution, which is checked below
        cp.Problem(cp.Maximize(value)).solve(solver=cp.CLARABEL)
    if x.value is not None and np.all(np.isfinite(x.value)):
        bodies = np.asarray(start + null @ x.value).reshape(n, 10)
        if _are_bodies(pseudo_inertia(bodies)):
            return bodies
    raise DerivationError("no rigid bodies have these base parameters: some inertia would have to be negative")
