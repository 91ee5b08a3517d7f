"""How a model shows itself: its summary as text and HTML, and drawings of the arm with matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.base.arrays import Array
from rrrgen.base.errors import require
from rrrgen.runtime.functions.table_functions import TableFunctions

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.runtime.model import Model


# ------------------------------------------------------------------------------------------------------------------
# Drawings of an arm with matplotlib: one configuration, several, or a motion.
# ------------------------------------------------------------------------------------------------------------------

COLORS = ("tab:red", "tab:green", "tab:blue")
"""Of the x, y and z axes of a frame."""


def corners(spec: RobotSpec, frames: Array, tip: Array) -> Array:
    """Polyline (..., 2 n + 2, 3), m, by which an arm is drawn: base, a corner and a frame origin per joint, and tip.

    ``frames`` (..., n, 4, 4) are the poses of the link frames, ``tip`` (..., 4, 4) that of the tip, in the base frame.
    A link is drawn along z by its DH parameter d and along x by a, with a corner between the two: by the standard
    convention at -a along the x axis of its own frame, by the modified one at +a along that of the previous frame.
    Branches of a tree are not drawn.
    """
    path = list(range(len(spec.rows)) if spec.mechanism is None else spec.mechanism.path(spec.tip_row))
    frames = frames[..., path, :, :]
    base = np.broadcast_to(np.array(spec.base.matrix().applyfunc(spec.nominal), dtype=float), tip.shape)
    every = np.concatenate([base[..., None, :, :], frames], axis=-3)
    origins, x = every[..., :3, 3], every[..., :3, 0]
    a = np.array([row[2] for row in spec.dh_table()])[path, None]
    if spec.convention == "standard":
        bends = origins[..., 1:, :] - a * x[..., 1:, :]
    else:
        placed = np.array(spec.placements())[path]  # the row begins turned by gamma and shifted by b along z
        y, z = every[..., :3, 1], every[..., :3, 2]
        c, s, b = np.cos(placed[:, :1]), np.sin(placed[:, :1]), placed[:, 1:]
        bends = origins[..., :-1, :] + a * (c * x[..., :-1, :] + s * y[..., :-1, :]) + b * z[..., :-1, :]
    between = np.stack([bends, origins[..., 1:, :]], axis=-2)
    between = between.reshape(*between.shape[:-3], -1, 3)
    return np.concatenate([origins[..., :1, :], between, tip[..., None, :3, 3]], axis=-2)


def plot_arm(path: Array, frames: Array, ax: Any, title: str) -> Any:
    """Draw k configurations of an arm as lines through the points ``path`` (k, p, 3), m.

    The x, y and z axes of ``frames`` (k, m, 4, 4) are drawn too. Returns the matplotlib axes.
    """
    ax = _axes(ax, path, title)
    size = 0.12 * _extent(path)[1]
    for k, (points, triads) in enumerate(zip(path, frames, strict=True)):
        color = "0.45" if len(path) == 1 else f"C{k}"  # to distinguish several configurations
        ax.plot(*points.T, "-", color=color, linewidth=4, solid_capstyle="round", solid_joinstyle="round")
        for T in triads:
            for axis, tone in enumerate(COLORS):
                ends = np.stack([T[:3, 3], T[:3, 3] + size * T[:3, axis]])
                ax.plot(*ends.T, "-", color=tone, linewidth=1.4)
    return ax


def animate_arm(path: Array, t: Array, ax: Any, title: str) -> Any:
    """A matplotlib animation in real time of an arm whose links pass ``path`` (N, p, 3) at the times ``t`` (N,), s.

    The path of the tip grows with the motion.
    """
    require("animate", "matplotlib")
    from matplotlib.animation import FuncAnimation

    ax = _axes(ax, path, title)
    (links,) = ax.plot(*path[0].T, "-", color="0.45", linewidth=4, solid_capstyle="round", solid_joinstyle="round")
    (trace,) = ax.plot(*path[:1, -1].T, "-", color="tab:blue", linewidth=1.2)
    shown = np.searchsorted(t, np.arange(t[0], t[-1], 0.04))  # 25 frames per second

    def show(k: int) -> tuple[Any, ...]:
        links.set_data_3d(*path[k].T)
        trace.set_data_3d(*path[: k + 1, -1].T)
        return links, trace

    update: Callable[..., Any] = show
    return FuncAnimation(ax.figure, update, frames=[int(k) for k in shown], interval=40, blit=False)


def _extent(path: Array) -> tuple[Array, float]:
    """Centre (3,) and half the edge length, m, of the cube around all points of ``path`` (..., 3), m."""
    points = path.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, float(max(np.max(high - low) / 2, 1e-3))


def _axes(ax: Any, path: Array, title: str) -> Any:
    """Set equal scales around ``path`` on the axes ``ax``, or on those of a new figure if None; returns the axes."""
    require("plot", "matplotlib")
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.figure(figsize=(6.0, 6.0)).add_subplot(projection="3d")
    middle, half = _extent(path)
    for setter, centre in zip((ax.set_xlim, ax.set_ylim, ax.set_zlim), middle, strict=True):
        setter(centre - 1.1 * half, centre + 1.1 * half)
    ax.set_box_aspect((1, 1, 1))
    ax.set(xlabel="x in m", ylabel="y in m", zlabel="z in m", title=title)
    return ax


# ------------------------------------------------------------------------------------------------------------------
# A short HTML summary of a compiled model, for notebooks.
# ------------------------------------------------------------------------------------------------------------------


def html_summary(model: Model) -> str:
    """HTML tables of the joints (nominal Denavit-Hartenberg rows in rad and m, limits) and the base parameters."""
    joints = [
        (name, kind, *map(_number, numbers), f"{_number(low)} .. {_number(high)}")
        for name, (kind, *numbers), low, high in zip(
            [row.name for row in model.spec.rows], model.spec.dh_table(), *_ends(model), strict=True
        )
    ]
    values = [""] * len(model.base_parameters) if model.beta is None else [_number(value) for value in model.beta]
    parameters = [
        (p.name, _mathematics(str(p.expression)), value, _mathematics(p.unit))
        for p, value in zip(model.derived.base_parameters, values, strict=True)
    ]
    return (
        f"<p><b>{escape(model.name)}</b>: {model.n} joints, {len(parameters)} base parameters, "
        f"{escape(model.spec.convention)} Denavit-Hartenberg convention</p>"
        + _table(("joint", "type", "alpha (rad)", "a (m)", "d (m)", "theta (rad)", "limits of q"), joints)
        + _table(("base parameter", "expression", "nominal value", "unit"), parameters)
    )


def _ends(model: Model) -> tuple[list[float], list[float]]:
    """Lower and upper position limits of the joints of all DH rows, rad or m, as the robot file states them."""
    known = {name: k for k, name in enumerate(model.joint_names)}
    lower, upper = [], []
    for row in model.spec.rows:
        k = known.get(row.name)
        ends = (row.limits.lower, row.limits.upper)
        lower.append(float(model.limits.lower[k]) if k is not None else -np.inf if ends[0] is None else ends[0])
        upper.append(float(model.limits.upper[k]) if k is not None else np.inf if ends[1] is None else ends[1])
    return lower, upper


def _mathematics(text: str) -> str:
    """Raise exponents: ``kg m^2`` becomes kg m², ``a2**2*m3`` becomes a2²·m3."""
    return text.replace("**2", "²").replace("^2", "²").replace("*", "·")


def _number(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ("-" if value < 0 else "") + "&infin;"


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    lines = ("".join(f"<td>{cell if cell.endswith('infin;') else escape(cell)}</td>" for cell in row) for row in rows)
    return f"<table><tr>{titles}</tr>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


# ------------------------------------------------------------------------------------------------------------------
# Drawings of a model; they need matplotlib.
# ------------------------------------------------------------------------------------------------------------------


class Drawings(TableFunctions):
    """Methods that draw or animate the arm; links are drawn as lines along the Denavit-Hartenberg parameters."""

    def plot(self, q: ArrayLike, ax: Any = None, frames: bool = True) -> Any:
        """Draw the arm with matplotlib: ``m.plot(m.inverse_kinematics(T).q)`` shows all solutions in one picture.

        Args:
            q: joint positions, (n,), or several configurations, (k, n), rad or m. Rows of NaN, which stand behind the
                solutions of an :class:`IKBatch`, are left out.
            ax: axes with ``projection="3d"`` to draw on; by default those of a new figure.
            frames: draw the axes of all link frames and of the tip: x red, y green, z blue.

        Returns:
            The matplotlib axes, lengths in m.

        Raises:
            MissingExtraError: matplotlib is not installed.
            ValueError: ``q`` has another shape, or there are no finite positions, as without a solution.
        """
        every = self._configurations(q, padded=True)
        links, tip = self.link_frames(every), self.forward_kinematics(every)
        triads = np.concatenate([links, tip[:, None]], axis=1) if frames else links[:, :0]
        return plot_arm(corners(self.spec, links, tip), triads, ax, self.spec.name)

    def animate(self, t: ArrayLike, q: ArrayLike, ax: Any = None) -> Any:
        """A motion as a matplotlib animation in real time, with the path of the tip.

        Args:
            t: times, (N,), s, increasing.
            q: joint positions at these times, (N, n), rad or m.
            ax: axes with ``projection="3d"`` to draw on; by default those of a new figure.

        Returns:
            The animation, to be kept while it is shown. ``.save(file)`` writes it, ``.to_jshtml()`` is for notebooks.

        Raises:
            MissingExtraError: matplotlib is not installed.
            ValueError: ``t`` does not increase, or ``q`` does not have one row for each point in time,
                all finite.
        """
        times, every = np.asarray(t, dtype=float), self._configurations(q)
        if times.shape != (len(every),) or len(every) < 2 or not np.all(np.diff(times) > 0.0):
            raise ValueError(f"t must be {len(every)} increasing times, two or more: one for each row of q")
        path = corners(self.spec, self.link_frames(every), self.forward_kinematics(every))
        return animate_arm(path, times, ax, self.spec.name)

    def _configurations(self, q: ArrayLike, padded: bool = False) -> Any:
        """``q`` as (k, n), all finite, where it may be ``padded`` by rows of NaN without these."""
        every = np.atleast_2d(np.asarray(q, dtype=float))
        if every.ndim != 2 or every.shape[1] != self.n:
            raise ValueError(f"q must be of shape ({self.n},) or (k, {self.n}), not {np.shape(q)}")
        finite = np.isfinite(every).all(axis=1)
        if not finite.any():
            raise ValueError("q holds no finite joint positions to plot")
        drawn = every[~np.isnan(every).all(axis=1)] if padded else every
        if not np.isfinite(drawn).all():
            raise ValueError(f"q must be finite to be plotted; row {int(np.argmin(finite))} is not")
        return drawn
