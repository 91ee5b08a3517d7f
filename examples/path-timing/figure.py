"""The figure of docs/path-timing.md: python examples/path-timing/figure.py -o docs

A Panda that carries a payload moves along a spline as fast as torques, speeds and friction allow.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import rrrgen
from rrrgen.lab.data.figure_style import new_figure, save_figure, style_axes

WAYPOINTS = np.array(
    [
        [0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8],
        [0.9, 0.1, -0.3, -1.5, 0.4, 2.0, 0.2],
        [1.2, 0.6, 0.2, -1.1, -0.3, 1.5, 1.2],
        [0.2, 0.2, 0.5, -2.0, 0.3, 2.2, 0.6],
        [-0.7, -0.3, 0.1, -2.4, -0.2, 1.8, 0.0],
    ]
)
VISCOUS = np.array([4.0, 4.0, 3.0, 3.0, 0.5, 0.5, 0.3])
COULOMB = np.array([1.5, 1.5, 1.2, 1.2, 0.3, 0.3, 0.2])
TORQUES = np.array([35.0, 75.0, 28.0, 38.0, 2.6, 4.0, 1.6])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("runs/path-timing"), metavar="DIR")
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    m = rrrgen.compile("panda")
    friction = np.stack([VISCOUS, COULOMB, np.zeros(7)], axis=1).ravel()
    beta = m.add_payload(mass=1.0, com=[0, 0, 0.15], inertia=1e-3 * np.eye(3))
    timed = m.time_path(
        rrrgen.spline_path(WAYPOINTS), tau_max=TORQUES, ddq_max=np.full(7, np.inf), friction=friction, beta=beta
    )
    t = np.linspace(0.0, timed.duration, 2002)[1:-1]  # at rest Coulomb friction has no direction
    motion = timed.sample(t)
    tau = m.inverse_dynamics(*motion, beta) + VISCOUS * motion.dq_d + COULOMB * np.sign(motion.dq_d)
    figure, axes = new_figure(3, 1, height=6.6, sharex=True)
    axes[0].plot(timed.t, timed.ds_dt, color="black")
    style_axes(axes[0], "", "ds/dt [1/s]")
    for j in range(7):
        axes[1].plot(t, motion.dq_d[:, j] / m.limits.velocity[j], label=f"q{j + 1}")
        axes[2].plot(t, tau[:, j] / TORQUES[j])
    for axis, label in ((axes[1], "speed / limit"), (axes[2], "torque / limit")):
        axis.axhline(1.0, color="black", linewidth=0.6, linestyle=":")
        axis.axhline(-1.0, color="black", linewidth=0.6, linestyle=":")
        style_axes(axis, "t [s]" if axis is axes[2] else "", label)
    axes[1].legend(ncol=7, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    save_figure(figure, folder / "path-timing")
    print(f"{timed.duration:.3f} s, largest torque / limit {np.max(np.abs(tau) / TORQUES):.4f}")


if __name__ == "__main__":
    main()
