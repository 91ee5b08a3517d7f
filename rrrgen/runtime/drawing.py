"""Drawings of an arm with matplotlib: one configuration, several, or a motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.extras import require

if TYPE_CHECKING:
    from rrrgen.robot.robot_spec import RobotSpec

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
        bends = origins[..., :-1, :] + a * x[..., :-1, :]
    between = np.stack([bends, origins[..., 1:, :]], axis=-2)
    between = between.reshape(*between.shape[:-3], -1, 3)
    return np.concatenate([origins[..., :1, :], between, tip[..., None, :3, 3]], axis=-2)


def plot_arm(path: Array, frames: Array, ax: Any, title: str) -> Any:
    """Draw arms whose links pass ``path`` (k, p, 3) and the axes of ``frames`` (k, m, 4, 4); returns the axes."""
    ax = _axes(ax, path, title)
    size = 0.12 * _extent(path)[1]
    for k, (points, triads) in enumerate(zip(path, frames, strict=True)):
        color = "0.45" if len(path) == 1 else f"C{k}"  # several configurations are told apart
        ax.plot(*points.T, "-", color=color, linewidth=4, solid_capstyle="round", solid_joinstyle="round")
        for T in triads:
            for axis, tone in enumerate(COLORS):
                ends = np.stack([T[:3, 3], T[:3, 3] + size * T[:3, axis]])
                ax.plot(*ends.T, "-", color=tone, linewidth=1.4)
    return ax


def animate_arm(path: Array, t: Array, ax: Any, title: str) -> Any:
    """A matplotlib animation in real time of an arm whose links pass ``path`` (N, p, 3) at the instants ``t`` (N,), s.

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
