"""The command ``rrrgen response linearise``: remove the nonlinear model from recordings before a frequency response."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rrrgen.base.errors import require
from rrrgen.cli.arguments import (
    input_files,
    json_option,
    log_option,
    output_option,
    print_json,
    print_repairs,
    read_with_warnings,
    robot_argument,
    truncated_option,
)
from rrrgen.cli.response_experiment import read_response_design
from rrrgen.cli.terminal import say, working


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
