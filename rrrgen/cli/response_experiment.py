"""Design and simulation of a response experiment, by the option ``--response`` of ``excite`` and ``simulate``."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.errors import option_name, require
from rrrgen.cli.arguments import described_files, print_json, read_with_warnings
from rrrgen.cli.terminal import doubtful, progress_bar, say

if TYPE_CHECKING:
    from rrrgen.lab.design.plan import ResponseDesign
    from rrrgen.lab.studies.excite import ExciteOptions
    from rrrgen.lab.studies.options import ExperimentOptions
    from rrrgen.lab.studies.simulate import SimulateOptions

OTHERS = ("harmonics", "starts", "cluster", "duration", "bandwidth", "control")
"""Options of either command that a response experiment does not use."""


def excite_response(robot: str, joint: str, options: ExciteOptions, output: Path, fresh: bool, as_json: bool) -> int:
    """Design the response experiment of the ``joint`` and write it to ``output``."""
    require("rrrgen experiment excite", "matplotlib")
    spec = read_with_warnings(robot)
    experiment = options.of_file(spec.n)
    _refuse(options)
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.design.plots import plot_response_excitation
    from rrrgen.lab.experiment.response import response_design, response_plan
    from rrrgen.runtime import load

    plan = response_plan(experiment, None if joint == EXPERIMENT_JOINT else joint)
    inputs = described_files(robot=Path(robot), experiment=options.experiment)
    settings = {"rate": options.rate, "response": asdict(plan)}
    with RunFolder(output, "excite", inputs, settings, experiment.seed, fresh) as folder:
        design = response_design(experiment, load.compile(spec), plan)
        results = folder.write_json("response_excitation.json", design.to_json())
        for run in design.runs:
            _write_samples(folder, design, run)
        unit = "rad/s²" if spec.joints[design.joint].is_revolute else "m/s²"
        folder.figure("response_excitation", plot_response_excitation(design, unit))
    first = design.runs[0]
    seconds = sum(len(run.n) for run in design.runs) * design.period
    if as_json:
        print_json({"excitation": str(results), "runs": [run.name for run in design.runs], "seconds": seconds})
    else:
        say(
            f"{len(design.runs)} runs of {design.joint_name}, {seconds:.1f} s: {design.signal}, "
            f"rms {first.n.std():.3g}, speed {abs(first.speed):.9g}"
        )
        say(f"excitation in {results}")
    return 0


EXPERIMENT_JOINT = "-"
"""Value of ``excite --response`` for the joint that the experiment file names."""


def _write_samples(folder: Any, design: ResponseDesign, run: Any) -> None:
    """Write the samples of the excitation and of the reference of one run, for the robot's controller."""
    import numpy as np

    t = design.period * np.arange(len(run.n))
    q, dq, _ = design.reference(run, t)
    n = q.shape[1]
    header = ("t", "n", *(f"q{i + 1}" for i in range(n)), *(f"dq{i + 1}" for i in range(n)))
    folder.write_csv(f"{run.name}.csv", header, np.column_stack([t, run.n, q, dq]).tolist())


def simulate_response_runs(
    robot: str, response: Path, options: SimulateOptions, output: Path, fresh: bool, as_json: bool
) -> int:
    """Run the designed experiment of the file ``response`` on the virtual robot and write its recordings."""
    require("rrrgen experiment simulate", "scipy")
    spec = read_with_warnings(robot)
    experiment = options.of_file(spec.n)
    _refuse(options)
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.experiment.loop_design import MARGIN
    from rrrgen.lab.experiment.response import response_margin, simulate_response
    from rrrgen.lab.plant.recording_files import write_responses
    from rrrgen.runtime import load

    design = read_response_design(response)
    if options.rate is None:
        experiment = replace(experiment, period=design.period)
    inputs = described_files(robot=Path(robot), response=response, experiment=options.experiment)
    settings = {name: getattr(options, name) for name in ("rate", "torque_noise", "base_mode")}
    with (
        RunFolder(output, "simulate", inputs, settings, experiment.seed, fresh) as folder,
        progress_bar() as progress,
    ):
        model = load.compile(spec)
        signals, controller = simulate_response(experiment, model, design, progress)
        margin = response_margin(experiment, model, design)
        prismatic = not spec.joints[design.joint].is_revolute
        paths = write_responses(folder.path / "results", design, signals, controller, prismatic)
    clipped = {loop_signals.run.name: loop_signals.clipped for loop_signals in signals if loop_signals.clipped}
    for name, count in clipped.items():
        click.echo(
            f"{doubtful('warning:')} {name}: {count} torques are clipped, so the loop is not linear; lower the rms",
            err=True,
        )
    if margin.modulus < MARGIN:
        state = "is unstable" if margin.unstable else f"has a modulus margin of {margin.modulus:.2f}, below {MARGIN}"
        click.echo(
            f"{doubtful('warning:')} the loop {state}, at {margin.frequency:.3g} Hz: a lower bandwidth in the section "
            "response, a higher rate or less delay makes it robust",
            err=True,
        )
    if as_json:
        names = [loop_signals.run.name for loop_signals in signals]
        print_json(
            {
                "responses": [str(path) for path in paths],
                "recordings": names,
                "clipped_torques": sum(clipped.values()),
                "modulus_margin": None if margin.unstable else margin.modulus,
            }
        )
    else:
        for path in paths:
            say(f"recordings in {path}: now rrrgen response frf {path} -o DIR")
    return 1 if margin.unstable else 0


def read_response_design(path: Path) -> ResponseDesign:
    """The design that ``rrrgen experiment excite --response`` wrote; raises InputError for another file."""
    from rrrgen.base.errors import InputError
    from rrrgen.lab.design.plan import ResponseDesign

    try:
        return ResponseDesign.from_json(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise InputError(f"{path}: {error}") from None


def _refuse(options: ExperimentOptions) -> None:
    for name in OTHERS:
        if getattr(options, name, None) is not None:
            described = "does not belong to a response experiment: the experiment file describes it"
            raise click.UsageError(f"{option_name(name)} {described}")
