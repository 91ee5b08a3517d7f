"""Drawings of a model; they need matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.runtime.functions.table_functions import TableFunctions


class Drawings(TableFunctions):
    """Methods that draw or animate the arm; links are drawn as lines along the Denavit-Hartenberg parameters."""

    def plot(self, q: ArrayLike, ax: Any = None, frames: bool = True) -> Any:
        """Draw the arm with matplotlib: ``m.plot(m.inverse_kinematics(T).q)`` shows all solutions in one picture.

        Args:
            q: joint positions, (n,), or several configurations, (k, n), rad or m.
            ax: axes with ``projection="3d"`` to draw on; by default those of a new figure.
            frames: draw the axes of all link frames and of the tip: x red, y green, z blue.

        Returns:
            The matplotlib axes, lengths in m.

        Raises:
            MissingExtraError: matplotlib is not installed.
            ValueError: ``q`` has another shape.
        """
        from rrrgen.runtime.drawing import corners, plot_arm

        every = self._configurations(q)
        links, tip = self.link_frames(every), self.forward_kinematics(every)
        triads = np.concatenate([links, tip[:, None]], axis=1) if frames else links[:, :0]
        return plot_arm(corners(self.spec, links, tip), triads, ax, self.spec.name)

    def animate(self, t: ArrayLike, q: ArrayLike, ax: Any = None) -> Any:
        """A motion as a matplotlib animation in real time, with the path of the tip.

        Args:
            t: instants, (N,), s, increasing.
            q: joint positions at these instants, (N, n), rad or m.
            ax: axes with ``projection="3d"`` to draw on; by default those of a new figure.

        Returns:
            The animation, to be kept while it is shown. ``.save(file)`` writes it, ``.to_jshtml()`` is for notebooks.

        Raises:
            MissingExtraError: matplotlib is not installed.
            ValueError: ``t`` does not increase, or ``q`` does not have one row for each instant.
        """
        from rrrgen.runtime.drawing import animate_arm, corners

        instants, every = np.asarray(t, dtype=float), self._configurations(q)
        if instants.shape != (len(every),) or len(every) < 2 or not np.all(np.diff(instants) > 0.0):
            raise ValueError(f"t must be {len(every)} increasing instants, two or more: one for each row of q")
        path = corners(self.spec, self.link_frames(every), self.forward_kinematics(every))
        return animate_arm(path, instants, ax, self.spec.name)

    def _configurations(self, q: ArrayLike) -> Any:
        every = np.atleast_2d(np.asarray(q, dtype=float))
        if every.ndim != 2 or every.shape[1] != self.n:
            raise ValueError(f"q must be of shape ({self.n},) or (k, {self.n}), not {np.shape(q)}")
        return every
