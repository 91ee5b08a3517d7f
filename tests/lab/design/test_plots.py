"""The figures of an excitation design show the design's own numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the search for exciting trajectories needs CasADi")
pytest.importorskip("matplotlib", reason="figures need matplotlib")

from lab.design.problems import BETA, pendulum_problem
from rrrgen.lab.data.figure_style import save_figure
from rrrgen.lab.design.design import ExcitationLimits, design_excitation
from rrrgen.lab.design.plots import (
    design_figures,
    plot_convergence,
    plot_information,
    plot_motion,
    plot_singular_values,
    plot_torque,
)
from samples.casadi_arms import double_pendulum_torque


@pytest.fixture(scope="module")
def design():
    return design_excitation(pendulum_problem(max_iterations=20), 2)


def test_motion_stays_between_its_dashed_limits(design) -> None:
    figure = plot_motion(design.trajectory, design.problem.limits)
    speed = figure.axes[1]
    curves = [line for line in speed.lines if line.get_linestyle() == "-"]
    dashed = {abs(line.get_ydata()[0]) for line in speed.lines if line.get_linestyle() == "--"}
    assert len(curves) == 2
    assert dashed == {6.0, 8.0}
    for line, limit in zip(curves, (6.0, 8.0), strict=True):
        assert np.abs(line.get_ydata()).max() <= limit * (1 + 1e-9)
    assert speed.get_ylabel() == "dq [rad/s]"


def test_other_figures_carry_the_verdict(design) -> None:
    condition = f"{design.best.check.condition:.4g}"
    assert condition in plot_singular_values(design).axes[0].get_legend().get_texts()[1].get_text()
    labels = [text.get_text() for text in plot_convergence(design).axes[0].get_legend().get_texts()]
    assert len(labels) == 2
    assert any(condition in label for label in labels)
    curve = plot_information(design, 200).axes[0].lines[0].get_ydata()
    assert curve[-1] == pytest.approx(design.best.check.condition, rel=1e-2)
    assert curve[0] > curve[-1]
    torque = plot_torque(np.arange(3.0), np.ones((3, 2)), limits=(2.0, np.inf))
    assert [len(axis.lines) for axis in torque.axes] == [3, 1]


def test_a_design_comes_with_all_its_figures(design) -> None:
    assert list(design_figures(design)) == ["motion", "singular_values", "condition", "starts"]
    limits = ExcitationLimits(speed=(6.0, 8.0), torque=(30.0, 10.0))
    limited = replace(design, problem=pendulum_problem(limits=limits, torque=double_pendulum_torque(BETA)))
    (panel, _) = design_figures(limited)["torque"].axes
    (q, dq, ddq) = design.trajectory.evaluate(0.0)
    assert panel.lines[0].get_ydata()[0] == pytest.approx(float(double_pendulum_torque(BETA)(q, dq, ddq)[0]), rel=1e-9)
    assert panel.lines[1].get_ydata()[0] == 30.0


def test_the_same_figure_gives_the_same_bytes(design, tmp_path) -> None:
    for name in ("one", "two"):
        save_figure(plot_motion(design.trajectory), tmp_path / name / "motion")
    for kind in ("svg", "png"):
        first, second = ((tmp_path / name / f"motion.{kind}").read_bytes() for name in ("one", "two"))
        assert first == second
        assert len(first) > 1000
