"""The command ``rrrgen experiment case-study``: run the case study on the virtual RRR."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click

from rrrgen.base.errors import require
from rrrgen.cli.arguments import jobs_options, json_option, output_option, print_json
from rrrgen.cli.terminal import mark_failed, progress_bar, say


@click.command()
@output_option
@jobs_options
@click.option(
    "--starts",
    type=click.IntRange(min=1),
    help="Number of random starts of the search for the exciting trajectory; default 4, or 1 with --quick.",
)
@click.option(
    "--quick",
    is_flag=True,
    help="Take half the time: fewer harmonics, postures, periods and friction laws; the same limits.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Seed for all random numbers.")
@json_option
def case_study(
    output: Path, jobs: int, cluster: str | None, starts: int | None, quick: bool, seed: int, as_json: bool
) -> int:
    """Run the whole case study on the virtual RRR: excitation, base parameters, writing task, flexible dynamics.

    Repeats section 14.6 of D. Kostic, B. de Jager, M. Steinbuch, Modeling and Identification for Robot Motion Control,
    Robotics and Automation Handbook, CRC Press 2005, on simulated data. Writes the results (JSON, CSV) and the figures
    of that chapter (SVG, PNG) to DIR, among them closed-form against recursive inverse kinematics and dynamics
    (Figs. 14.7 and 14.8). An interrupted run is resumed. Takes two minutes, or one with --quick; exits with 1 if a
    result misses its required accuracy.

    \b
    Examples:
      rrrgen experiment case-study --quick -o runs/case-study
      rrrgen experiment case-study -o runs/case-study --jobs 2
    """
    require("rrrgen experiment case-study", "casadi", "scipy", "matplotlib", "cvxpy", "clarabel")
    from rrrgen.lab.experiment.case_study.case_study import QUICK, CaseStudySettings, run_case_study

    with progress_bar() as progress:
        settings = replace(QUICK if quick else CaseStudySettings(), seed=seed)
        settings = settings if starts is None else replace(settings, starts=starts)
        study = run_case_study(output, settings, jobs=jobs, cluster=cluster, progress=progress)
    if as_json:
        print_json(study.to_json())
        return 1 if study.failures else 0
    estimate = study.identification.estimate
    say(f"excitation: condition number {study.design.best.check.condition:.3f} on the controller's grid")
    say(f"{'parameter':>10} {'estimate':>12} {'std':>10} {'truth':>12} {'in std':>7}")
    rows = zip(estimate.names, estimate.x, estimate.std, study.truth, study.deviations, strict=True)
    for name, value, std, truth, deviation in rows:
        say(f"{name:>10} {value:12.5f} {std:10.2e} {truth:12.5f} {deviation:7.2f}")
    say(f"writing task: torque error {100 * study.validation.relative_error:.2f} % of the RMS torque")
    for score in study.validation.joints:
        moving, whole = 100 * score.relative_error, 100 * score.relative_error_all
        say(
            f"  {score.joint}: {moving:.2f} % while it moves, {100 * score.share:.0f} % of the samples; "
            f"{whole:.1f} % including rest, where friction is not determined by the speed"
        )
    for row in study.flexible.resonances:
        if row["measured"] is not None:
            say(
                f"joint 1, {row['posture']}: resonance {row['measured']['frequency']:.2f} Hz, by M(q) and stiffness "
                f"{row['computed']['frequency']:.2f} Hz"
            )
    for failure in study.failures:
        say(f"{mark_failed('not reached:')} {failure}")
    say(f"results and figures in {output}")
    return 1 if study.failures else 0
