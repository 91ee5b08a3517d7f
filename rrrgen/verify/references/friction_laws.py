"""A second implementation of the friction laws, for comparison: in sliding, and over one period with a state."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rrrgen.robot.spec import FrictionSpec, LawSpec
from rrrgen.verify.references.numeric_robot import Array


def sliding(friction: FrictionSpec | None, v: Array, width: float = 0.0, load: Array | float = 0.0) -> Array:
    """Friction torque (N,) at the speeds ``v`` (N,) under the torques ``load`` (N,), in steady sliding.

    ``width`` > 0 replaces sgn(v) by tanh(v / width), in |v| = v sgn(v) too.
    """
    if friction is None:
        return np.zeros_like(v)
    offset = friction.offset or 0.0
    s = np.tanh(v / width) if width else np.sign(v)
    if friction.law is None:
        return (friction.viscous or 0.0) * v + (friction.coulomb or 0.0) * s + offset
    return np.asarray(_law(friction.law, v, s, v * s, load) + offset)


def change_parameters(friction: FrictionSpec) -> FrictionSpec:
    """Change the parameters of a law to other values, none of them zero."""
    if friction.law is None:
        known = (friction.viscous, friction.coulomb, friction.offset)
        viscous, coulomb, offset = (
            1.25 * (value or start) for value, start in zip(known, (0.5, 2.0, 0.125), strict=True)
        )
        return FrictionSpec(viscous, coulomb, offset)
    law = replace(friction.law, values=tuple(1.25 * value for value in friction.law.values))
    return replace(friction, law=law, offset=1.25 * (friction.offset or 0.5))


def parameters_of(friction: FrictionSpec) -> list[float]:
    """The parameters of a joint's or motor's friction, in the order in which the emitted functions take them."""
    if friction.law is None:
        return [friction.viscous or 0.0, friction.coulomb or 0.0, friction.offset or 0.0]
    return [*friction.law.values, friction.offset or 0.0]


def has_state(friction: FrictionSpec | None) -> bool:
    """Whether the law of ``friction`` has a state; False for None."""
    return (
        friction is not None
        and friction.law is not None
        and friction.law.name in ("dahl", "dahl_exponential", "dahl_load_dependent", "lugre")
    )


def has_load(friction: FrictionSpec | None) -> bool:
    """Whether the law of ``friction`` depends on the load torque; False for None."""
    return friction is not None and friction.law is not None and friction.law.name.endswith("load_dependent")


def integrate(
    friction: FrictionSpec, v: Array, z: Array, period: float, load: Array | float = 0.0
) -> tuple[Array, Array]:
    """Integrate a law over one ``period`` (s) at the constant speeds ``v`` (N,) from the states ``z`` (N,).

    Returns the state (N,) and the friction torque (N,) at the end of the period.
    """
    law = friction.law
    assert law is not None
    p, offset = law.values, friction.offset or 0.0
    if law.name == "lugre":
        sigma0, sigma1, excess, coulomb, viscous, speed = p
        level = (coulomb + excess * np.exp(-((v / speed) ** 2))) / sigma0
        after = _relax(z, level * np.sign(v), np.abs(v) / level * period)
        return after, sigma0 * after + sigma1 * (after - z) / period + viscous * v + offset
    after = _relax(z, p[-1] * np.sign(v), np.abs(v) / p[-1] * period)
    return after, np.asarray(_law(law, v, after / p[-1], np.abs(v), load) + offset)


def _relax(z: Array, final: Array, decay: Array) -> Array:
    return final + (z - final) * np.exp(-decay)


def _law(law: LawSpec, v: Array, s: Array, size: Array, load: Array | float) -> Any:
    """Friction torque (N,) by the formula of ``law`` at speeds ``v`` (N,) with the direction ``s`` (N,), -1 to 1.

    s is sgn(v), or the state divided by its value in steady sliding. ``size`` (N,) is |v|, ``load`` (N,) the load
    torque.
    """
    p = np.array(law.values)
    match law.name:
        case "asymmetric" | "asymmetric_exponential":
            decaying = p[4] * np.exp(-size / p[5]) * s if len(p) > 4 else 0.0
            forwards, backwards = (s * s + s) / 2, (s * s - s) / 2  # 1 in one direction, 0 in the other
            speeds = p[0] * (size + v) / 2 - p[1] * (size - v) / 2
            return decaying + speeds + p[2] * forwards - p[3] * backwards
        case "exponential":
            return (p[0] * np.exp(-size / p[3]) + p[1]) * s + p[2] * v
        case "stribeck" | "lugre":
            excess, coulomb, viscous, speed = p[-4:]
            return (excess * np.exp(-((v / speed) ** 2)) + coulomb) * s + viscous * v
        case "dahl":
            return p[0] * s + p[1] * v
        case "dahl_exponential":
            return (p[0] * np.exp(-size / p[4]) + p[1]) * s + (p[2] + p[3] * size) * v
        case "load_dependent":
            return (p[0] + p[2] * np.abs(load)) * s + p[1] * v
        case "dahl_load_dependent":
            return (p[0] * np.exp(-size / p[5]) + p[1] + p[4] * np.abs(load)) * s + (p[2] + p[3] * size) * v
        case "logistic":
            return p[0] / (1 + np.exp(-p[1] * (v + p[2]))) - p[0] / (1 + np.exp(-p[1] * p[2]))
        case "neural":
            half = len(p) // 2
            units = sum(f * np.tanh(w * v) for f, w in zip(p[:half], p[half : 2 * half], strict=True))
            return units + p[-1] * v
        case _:
            return p[0] * v + p[1] * s + p[2]
