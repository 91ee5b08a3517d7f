"""Figures of a friction estimate: friction over speed, and torques over time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.friction.initial_values import sliding_samples
from rrrgen.robot.friction.laws import LEAST
from rrrgen.robot.spec import FrictionSpec, LawSpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrrgen.base.arrays import Array
    from rrrgen.lab.friction.estimation import FrictionEstimate, LawEstimate
    from rrrgen.lab.friction.presliding import Presliding
    from rrrgen.robot.spec import RobotSpec

CURVE = 600  # points of a curve in either direction
SHOWN = 10.0  # s of the experiment that are drawn
MOST_POINTS = 6000  # largest number of measured points that are drawn
SLOW = 3.0  # times the Stribeck speed: range of the panel of low speeds (without one, a tenth of the whole range)


def plot_friction(estimate: FrictionEstimate, units: tuple[str, str] = ("rad/s", "N m")) -> Figure:
    """Plot friction over speed: the measured points and the curve of every law, the chosen one in front.

    One panel shows the whole range, one the low speeds. ``units`` are those of speed and torque.
    """
    figure, axes = new_figure(1, 2, height=3.6, width=9.0)
    _draw_friction(axes, estimate, units)
    return figure


def plot_experiment(estimate: FrictionEstimate, units: tuple[str, str] = ("rad/s", "N m")) -> Figure:
    """Plot recorded torque and speed around the change from fast to slow motion, beside friction over speed.

    The arrangement is that of Fig. 14.9. The torque of the chosen law, by inverse dynamics, is drawn at the samples at
    which the joint slides. ``units`` are those of speed and torque.
    """
    figure, axes = new_figure(2, 2, height=5.6, width=10.0)
    _draw_friction(axes[[1, 3]], estimate, units)
    data, law = estimate.data, estimate.chosen
    first = max(0, len(data.q) // 2 - round(SHOWN / 2.0 / data.period))
    part = slice(first, first + round(SHOWN / data.period))
    t = np.arange(len(data.q))[part] * data.period
    q, dq, ddq = (values[part] for values in data.motion)
    model = law.theta[0] * ddq + law.candidate.gravity_torque(q, law.theta) + law.candidate.torque(dq, law.theta)
    model[~data.sliding[part]] = np.nan
    axes[0].plot(t, data.u[part], color="0.7", linewidth=1.6, label="measured")
    axes[0].plot(t, model, color="C3", linewidth=0.8, label=f"model, {law.name}")
    axes[0].legend(loc="upper right", fontsize=8)
    style_axes(axes[0], "", f"torque [{units[1]}]")
    axes[2].plot(t, dq, linewidth=0.8)
    style_axes(axes[2], "t [s]", f"speed [{units[0]}]")
    return figure


def _draw_friction(axes: Any, estimate: FrictionEstimate, units: tuple[str, str]) -> None:
    """Draw friction over speed into two axes: the whole range, and low speeds."""
    speed, friction = _cloud(estimate)
    top = float(np.max(np.abs(speed)))
    slow = min(top, SLOW * estimate.chosen.values.get("stribeck_speed", top / 30.0))
    for axis, limit in zip(axes, (top, slow), strict=True):
        inside = np.flatnonzero(np.abs(speed) <= limit)
        shown = inside[:: max(1, len(inside) // MOST_POINTS)]
        axis.plot(speed[shown], friction[shown], ".", color="0.7", markersize=3.0, zorder=1, rasterized=True)
        for law in estimate.laws:
            is_chosen = law is estimate.chosen
            style = {"color": "k", "linewidth": 1.4, "zorder": 3} if is_chosen else {"linewidth": 1.0, "zorder": 2}
            axis.plot(*_curve(law, limit), label=f"{law.name}{' (chosen)' if is_chosen else ''}", **style)
        style_axes(axis, f"speed [{units[0]}]", f"friction [{units[1]}]")
        axis.set_xlim(-1.05 * limit, 1.05 * limit)
    axes[0].set_title(
        f"joint {estimate.data.name}; grey: torque - J ddq - gravity while sliding", fontsize=9, loc="left"
    )
    axes[1].set_title("low speeds", fontsize=9, loc="left")
    axes[0].legend(loc="lower right", fontsize=8)


def _cloud(estimate: FrictionEstimate) -> tuple[Array, Array]:
    """Speeds and measured friction torques at samples at which the joint slides, (N,) each.

    Friction is the recorded torque minus the inertia and gravity torques of the chosen law.
    """
    law, theta = estimate.chosen.candidate, estimate.chosen.theta
    samples = sliding_samples(estimate.data, float(theta[-1]))
    friction = samples.tau - theta[0] * samples.ddq - law.gravity_torque(samples.q, theta)
    return samples.dq, friction


def _curve(law: LawEstimate, limit: float) -> tuple[Array, Array]:
    """Speeds from -``limit`` to ``limit`` and the friction torques of ``law`` there, with the jump at zero speed."""
    speed = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, CURVE) * limit])
    columns = list(law.theta)
    forward, backward = (law.candidate.torque(s * speed, columns, s) for s in (1.0, -1.0))
    return np.concatenate([-speed[::-1], speed]), np.concatenate([backward[::-1], forward])


# ------------------------------------------------------------------------------------------------------------------
# Puts the chosen friction law into the robot file.
# ------------------------------------------------------------------------------------------------------------------

CERTAIN = 3.0  # standard deviations from zero from which on a torque offset is written


def with_friction(spec: RobotSpec, joint: str, chosen: LawEstimate, rest: Presliding | None = None) -> RobotSpec:
    """A copy of ``spec`` whose joint named ``joint`` has the law ``chosen``; all else stays as it is.

    An estimated offset of the torque is part of it where it is certain.
    Stiffness and damping of LuGre bristles are replaced by the values of ``rest``, a presliding measurement, if those
    have the smaller standard deviations.
    """
    law = chosen.candidate.law
    values = dict(
        zip((p.name for p in law.parameters), chosen.candidate.law_values(chosen.theta.tolist()), strict=True)
    )
    if rest is not None:
        measured = {"sigma0": rest.sigma0, "sigma1": rest.sigma1}
        for name, pair in measured.items():
            if pair is not None and name in values and pair[1] < chosen.std[name]:
                values[name] = pair[0]
    offset = chosen.values.get("offset")
    if offset is not None and abs(offset) < CERTAIN * chosen.std["offset"]:
        offset = None
    if law.damping:  # bristles carry something at rest, or the robot file would be refused
        values["coulomb"] = max(values["coulomb"], LEAST)
        values["stiction_excess"] = max(values["stiction_excess"], LEAST - values["coulomb"])
    if law.name == "coulomb_viscous":
        friction = FrictionSpec(viscous=values["viscous"], coulomb=values["coulomb"], offset=offset)
    else:
        numbers = tuple(max(values[p.name], LEAST) if p.positive else values[p.name] for p in law.parameters)
        friction = FrictionSpec(law=LawSpec(law.name, numbers), offset=offset)
    joints = tuple(replace(row, friction=friction) if row.name == joint else row for row in spec.joints)
    return replace(spec, joints=joints)
