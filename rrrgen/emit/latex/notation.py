r"""The mathematical notation of names: ``ddq2`` is q with two dots and the subscript 2, ``Ixx3`` is I_{xx,3}.

Cosines and sines of a sum of joint angles have the short form of the literature, c_{23} = cos(q_2 + q_3), whenever the
sum has no offset, no factors and single-digit joints; :func:`short_angle` recognises it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import sympy as sp

GREEK = {
    "alpha": "α", "beta": "β", "gamma": "γ", "delta": "δ", "epsilon": "ε", "zeta": "ζ", "eta": "η", "theta": "θ",
    "kappa": "κ", "lambda": "λ", "mu": "μ", "nu": "ν", "xi": "ξ", "pi": "π", "rho": "ρ", "sigma": "σ", "tau": "τ",
    "phi": "φ", "chi": "χ", "psi": "ψ", "omega": "ω",
}  # fmt: skip

_JOINT = re.compile(r"(d{0,2})q_?(\d+)")
_INERTIAL = re.compile(r"([IJ]|h|m)([xyz]{1,2})_?(\d+R?)")
_DRIVE = re.compile(r"(I|f)([avco])_?(\d+)")
_NUMBERED = re.compile(r"([A-Za-z]+?)_?(\d+R?)")
_WORDED = re.compile(r"([A-Za-z]+)(\d*)_(\w+)")


@dataclass(frozen=True)
class Notation:
    """``base`` with ``dots`` above and ``subscript`` parts below, separated by commas."""

    base: str
    subscript: tuple[str, ...] = ()
    dots: int = 0


def notation(name: str) -> Notation:
    """Split the name of a symbol into letter, dots and subscript, as in ``ddq2`` -> q, two dots, 2."""
    if match := _JOINT.fullmatch(name):
        return Notation("q", (match[2],), len(match[1]))
    if match := _INERTIAL.fullmatch(name):
        kind, axes, link = match.groups()
        if kind == "m":
            return Notation(f"m{axes}", (link,))
        return Notation(kind, (axes, link))
    if match := _DRIVE.fullmatch(name):
        return Notation(match[1], (match[2], match[3]))
    if match := _NUMBERED.fullmatch(name):
        return Notation(match[1], (match[2],))
    if match := _WORDED.fullmatch(name):
        return Notation(match[1], (match[2], match[3]) if match[2] else (match[3],))
    return Notation(name)


def short_angle(angle: sp.Expr) -> str | None:
    """The subscript that abbreviates a sum of joint angles: ``"23"`` for q2 + q3; None where it would be ambiguous."""
    joints = []
    for term in sp.Add.make_args(angle):
        match = re.fullmatch(r"q([1-9])", str(term)) if term.is_Symbol else None
        if match is None:
            return None
        joints.append(match[1])
    return "".join(sorted(joints))


@dataclass(frozen=True)
class Quantity:
    """The notation of a model function: letter, arguments and meaning."""

    letter: str
    arguments: tuple[str, ...]
    meaning: str


QUANTITIES = {
    "forward_kinematics": Quantity("T", ("q",), "pose of the tip in the base frame"),
    "jacobian": Quantity("J", ("q",), "geometric Jacobian, linear rows first"),
    "kinematics.T": Quantity("T", ("q",), "pose of the tip in the base frame"),
    "kinematics.J": Quantity("J", ("q",), "geometric Jacobian, linear rows first"),
    "mass_matrix": Quantity("M", ("q",), "mass matrix"),
    "coriolis_matrix": Quantity("C", ("q", "dq"), "Coriolis matrix"),
    "coriolis": Quantity("c", ("q", "dq"), "Coriolis and centrifugal torques"),
    "gravity": Quantity("g", ("q",), "gravity torques"),
    "dynamics_terms.M": Quantity("M", ("q",), "mass matrix"),
    "dynamics_terms.c": Quantity("c", ("q", "dq"), "Coriolis and centrifugal torques"),
    "dynamics_terms.g": Quantity("g", ("q",), "gravity torques"),
    "inverse_dynamics": Quantity("tau", ("q", "dq", "ddq"), "joint torques"),
    "inverse_dynamics_derivatives.tau": Quantity("tau", ("q", "dq", "ddq"), "joint torques"),
    "inverse_dynamics_derivatives.dtau_dq": Quantity("D_q", ("q", "dq", "ddq"), "derivatives of the torques by q"),
    "inverse_dynamics_derivatives.dtau_dv": Quantity("D_v", ("q", "dq"), "derivatives of the torques by dq"),
    "inverse_dynamics_derivatives.M": Quantity("M", ("q",), "mass matrix"),
    "regressor": Quantity("Y", ("q", "dq", "ddq"), "regressor of the base parameters"),
    "standard_regressor": Quantity(
        "Y", ("q", "dq", "ddq"), "regressor of the standard parameters, Ixy = -integral of x*y dm"
    ),
    "energy.kinetic": Quantity("T", ("q", "dq"), "kinetic energy"),
    "energy.potential": Quantity("U", ("q",), "potential energy"),
    "friction": Quantity("tau_f", ("dq",), "friction torques"),
    "base_parameters": Quantity("beta", (), "base parameters"),
}


def quantity(name: str) -> Quantity:
    """The notation of a model function; an unknown name is its own letter."""
    return QUANTITIES.get(name, Quantity(name, (), name.replace("_", " ")))
