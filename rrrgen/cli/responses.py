"""The commands ``rrrgen response``: frequency responses of a joint or an arm, and models with resonances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rrrgen.base.errors import require
from rrrgen.cli.arguments import (
    FindingsPrinter,
    fresh_option,
    input_files,
    json_option,
    log_option,
    output_option,
    print_json,
    print_repairs,
    read_with_warnings,
    robot_argument,
    robot_source,
    run_on_recordings,
    run_study,
    truncated_option,
)
from rrrgen.cli.response_experiment import read_response_design
from rrrgen.cli.study_options import click_options, recording_options
from rrrgen.cli.terminal import say, working
from rrrgen.lab.studies.fit_response import FitResponseOptions
from rrrgen.lab.studies.frequency_response import FrequencyResponseOptions
from rrrgen.lab.studies.matrix_response import MatrixResponseOptions


@click.command()
@click.argument("log", type=click.Path(path_type=Path))
@output_option
@click_options(FrequencyResponseOptions)
@fresh_option
@json_option
def frf(log: Path, output: Path, options: FrequencyResponseOptions, fresh: bool, as_json: bool) -> int:
    """Estimate the frequency response of a joint, output over input, from recordings in closed loop.

    LOG is a response file (schema rrrgen-response/1): which columns are the excitation n, the input u and the output q.
    Writes results/frf.json, with 95 % bands, the coherence and a verdict on every line, and a Bode diagram. Distortion,
    such as friction at changes of direction or quantisation that repeats in every period, biases all lines at once: the
    verdict on the recording is then negative, and the command exits with 1.

    \b
    Example:
      rrrgen response frf joint1.yaml -o runs/response
    """
    from rrrgen.lab.studies.frequency_response import frequency_response

    result = run_study(frequency_response, log, options, folder=output, fresh=fresh, as_json=as_json)
    return 0 if result.trusted else 1


@click.command(name="matrix")
@recording_options(MatrixResponseOptions)
def matrix(
    robot: str, logs: tuple[Path, ...], output: Path, options: MatrixResponseOptions, as_json: bool, **more: Any
) -> int:
    """Estimate the frequency response of a whole arm, from the torques of all joints to all positions.

    The recordings are those of experiments with a periodic excitation, in every posture as many as joints or more, each
    excited in its own way. Writes matrix_response.json to DIR: all elements with 95 % bands, the resonances that they
    share, and, where ROBOT states masses, stiffness and inertia of the drives, those that these lead to. Exits with 1
    if a recording cannot be trusted.

    \b
    Example:
      rrrgen response matrix arm.yaml --log first.yaml --log second.yaml --period 2 -o runs/matrix
    """
    from rrrgen.lab.studies.matrix_response import matrix_response

    result = run_on_recordings(matrix_response, robot, logs, options, output, as_json, **more)
    return 0 if result.trusted else 1


@click.command(name="response-model")
@click.argument("log", type=click.Path(path_type=Path), metavar="LOG_OR_FRF")
@output_option
@click_options(FitResponseOptions)
@click.option("--robot", metavar="ROBOT", help="With --experiment: also compute the resonances.")
@click.option("--experiment", type=click.Path(path_type=Path), help="Experiment file with elastic parts and postures.")
@click.option("--joint", metavar="NAME", help="Joint of the response, if the experiment file does not state it.")
@fresh_option
@json_option
def response_model(
    log: Path,
    output: Path,
    options: FitResponseOptions,
    robot: str | None,
    experiment: Path | None,
    joint: str | None,
    fresh: bool,
    as_json: bool,
) -> int:
    """Fit a linear model with its resonances to a recording (response file) or to a frf.json of `rrrgen response frf`.

    auto fits modes to the frequency response where the recording has an excitation beside the input (a closed loop),
    and otherwise a difference equation: ARX, ARMAX or output error. Orders are chosen within the rows to fit. Several
    postures get a model each. Writes results/response_model.json, C of one step of the model in state space, and
    figures. Exits with 1 where the response of a posture cannot be trusted.

    --robot and --experiment, the file that `rrrgen experiment simulate --response` reads, print the resonances that the
    mass matrix of the robot and the elastic joints and base of the experiment lead to beside the measured ones.

    \b
    Example:
      rrrgen response model runs/response/results/frf.json -o runs/model
      rrrgen response model arm.yaml --fit-rows 1:512 -o runs/model
    """
    from rrrgen.lab.studies.fit_response import fit_response

    result = run_study(
        fit_response,
        log,
        options,
        robot=None if robot is None else robot_source(robot),
        experiment=experiment,
        joint=joint,
        folder=output,
        fresh=fresh,
        findings=FindingsPrinter(as_json),
        as_json=as_json,
    )
    return 1 if result.refused else 0


@click.command()
@robot_argument
@log_option
@click.option(
    "--response",
    required=True,
    type=click.Path(path_type=Path, exists=True),
    help="The designed experiment: response_excitation.json of `rrrgen experiment excite --response`.",
)
@click.option("--run", "runs", multiple=True, metavar="NAME", help="The run of the design in each --log; in order.")
@output_option
@truncated_option
@click.option("--fresh", is_flag=True, help="Discard a run that DIR already holds, and start over.")
@json_option
def linearise(robot: str, logs: tuple[Path, ...], output: Path, as_json: bool, **options: Any) -> int:
    """Turn recordings of positions and torques into recordings of a frequency response.

    From the torques of all joints follows the input u = inv(M) (tau - c - g - tau_f) of the linearised arm (14.34),
    with the model and friction of the robot file along the designed motion. The excitation is found in each recording;
    transients are left out. Writes the recordings and response.yaml for `rrrgen response frf` to DIR.

    \b
    Example:
      rrrgen response linearise my_arm.yaml --log log.yaml --response runs/plan/results/response_excitation.json -o q1
    """
    require("rrrgen response linearise", "scipy")
    from rrrgen.lab.data.recordings import load_stream, open_log
    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.data.uniform_stream import LogStream
    from rrrgen.lab.experiment.feedback_linearisation import linearised_log
    from rrrgen.lab.plant.recording_files import write_responses
    from rrrgen.runtime import load

    spec = read_with_warnings(robot)
    design = read_response_design(options["response"])
    by_name = {run.name: run for run in design.runs}
    names = options["runs"] or tuple(by_name)[: len(logs)]
    unknown = [name for name in names if name not in by_name]
    if unknown or len(names) != len(logs):
        problem = f"'{unknown[0]}' is no run of the design" if unknown else f"{len(logs)} recordings, {len(names)} runs"
        raise click.UsageError(f"{problem}: it has {', '.join(by_name)}")
    mappings = [open_log(log, skip_truncated=options["skip_truncated_line"]) for log in logs]
    inputs = {**input_files(robot, logs, mappings), "response": options["response"]}
    settings = {"runs": list(names), "skip_truncated_line": options["skip_truncated_line"]}
    with (
        RunFolder(output, "linearise", inputs, settings, 0, options["fresh"]) as folder,
        working("subtracting the rigid body"),
    ):
        recordings = [load_stream(LogStream(mapping)) for mapping in mappings]
        print_repairs([recording.repairs for recording in recordings], as_json)
        model = load.compile(spec)
        signals = [
            linearised_log(model, recording, design, by_name[name])
            for recording, name in zip(recordings, names, strict=True)
        ]
        prismatic = not spec.joints[design.joint].is_revolute
        paths = write_responses(folder.path / "results", design, signals, None, prismatic)
    if as_json:
        print_json({"responses": [str(path) for path in paths], "recordings": list(names)})
    else:
        for path in paths:
            say(f"recordings in {path}: now rrrgen response frf {path} -o DIR")
    return 0
