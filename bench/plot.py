"""Results as one figure: instructions per call, and growth with the number of joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench.contenders.contender import HAND, OURS, PINOCCHIO, TITLES
from bench.results import Results, work

COLOURS = {OURS: "#0b6e4f", HAND: "#e08e0b", PINOCCHIO: "#8a8fa3"}
SHOWN = ("inverse_dynamics", "mass_matrix", "bias", "gravity", "forward_dynamics", "kinematics", "regressor")
RANGE = (50.0, 30000.0)
"""Lower end of the logarithmic axis, the same for all robots."""
SHORT = {"bias": "c + g", "mass_matrix": "M", "kinematics": "FK + J", "gravity": "g"}


def plot(results: Results, directory: Path) -> None:
    """Write ``benchmark.svg`` and ``benchmark.png``."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    robots = results.robots()
    counted = all(score.instructions is not None for score in results.scores)
    unit = "instructions per call" if counted else "ns per call"
    with plt.rc_context(
        {"svg.hashsalt": "rrrgen", "font.size": 9, "axes.spines.top": False, "axes.spines.right": False}
    ):
        columns = 2
        rows = -(-len(robots) // columns) + (1 if results.growth else 0)
        figure = plt.figure(figsize=(10, 2.9 * rows), layout="constrained")
        grid = figure.add_gridspec(rows, columns)
        for k, robot in enumerate(robots):
            _bars(figure.add_subplot(grid[k // columns, k % columns]), results, robot, unit, legend=k == 0)
        if results.growth:
            for k, function in enumerate(("inverse_dynamics", "mass_matrix")):
                _lines(figure.add_subplot(grid[rows - 1, k]), results, function, unit)
        figure.savefig(directory / "benchmark.svg", metadata={"Date": None})
        figure.savefig(directory / "benchmark.png", dpi=300)
        plt.close(figure)


def _bars(axes: Any, results: Results, robot: str, unit: str, legend: bool) -> None:
    width = 0.27
    for k, label in enumerate(COLOURS):
        for place, function in enumerate(SHOWN):
            score = results.score(robot, function, label)
            if score is not None:
                named = label if place == 0 else None
                axes.bar(place + (k - 1) * width, work(score), width, color=COLOURS[label], label=named)
    axes.set_yscale("log")
    axes.set_ylim(RANGE if "instructions" in unit else (RANGE[0] / 10, RANGE[1] / 10))
    names = [
        SHORT.get(name, TITLES[name]).replace(" ", "\n", 1) if name not in SHORT else SHORT[name] for name in SHOWN
    ]
    axes.set_xticks(range(len(SHOWN)), names, fontsize=8)
    axes.set_title(robot, loc="left", fontweight="bold")
    axes.set_ylabel(unit)
    if legend:
        axes.legend(frameon=False, ncols=3, fontsize=8, loc="upper left", bbox_to_anchor=(0.1, 1.17))


def _lines(axes: Any, results: Results, function: str, unit: str) -> None:
    for label, colour in COLOURS.items():
        points = [
            (int(score.robot.removeprefix("chain")), work(score))
            for score in results.growth
            if (score.contender.function, score.contender.label) == (function, label)
        ]
        if points:
            axes.plot(*zip(*points, strict=True), "o-", color=colour, label=label, markersize=3.5)
    axes.set_title(f"{TITLES[function]}, random chains", loc="left", fontweight="bold")
    axes.set_xlabel("joints")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_ylabel(unit)
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False, fontsize=8)
