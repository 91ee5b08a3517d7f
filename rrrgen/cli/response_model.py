"""The command ``rrrgen response-model``: fit a linear model with resonances to a recording or frequency response."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.extras import require
from rrrgen.base.tables import text_table
from rrrgen.cli.arguments import json_option, print_json, real_option
from rrrgen.cli.progress import working
from rrrgen.cli.terminal import say, terminal_width
from rrrgen.cli.workflow import output_option

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rrrgen.lab.plant.elastic_modes import ElasticMode
    from rrrgen.lab.response.fitting import FittedModels
    from rrrgen.lab.response.response_model import Resonance, ResponseModel
    from rrrgen.program import Program

OTHER_PROTOCOLS = {
    "free_run_with_state_from_fitted_rows": "free run with the state that the fitted rows lead to",
    "free_run_from_zero_state": "free run from the state zero",
    "one_step": "one step ahead",
}
COARSE = 1e-6  # relative error by the rounding of a and b that is told
METHODS = ("auto", "modes", "arx", "armax", "output_error", "subspace", "indirect")


def _rows(ctx: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Parse the option ``--fit-rows A:B`` as two row numbers, counted from 1."""
    if value is None:
        return None
    match = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*", value)
    if match is None or not 1 <= int(match[1]) < int(match[2]):
        raise click.BadParameter(f"'{value}' is no range of rows, e.g. 1:512; rows count from 1", ctx, parameter)
    return int(match[1]), int(match[2])


@click.command(name="response-model")
@click.argument("log", type=click.Path(path_type=Path), metavar="LOG_OR_FRF")
@output_option
@click.option("--fit-rows", callback=_rows, metavar="A:B", help="Rows to fit, counted from 1; the others test it.")
@click.option("--method", type=click.Choice(METHODS), default="auto", show_default=True, help="Kind of model.")
@click.option("--robot", metavar="ROBOT", help="With --experiment: also compute the resonances.")
@click.option("--experiment", type=click.Path(path_type=Path), help="Experiment file with elastic parts and postures.")
@real_option
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def response_model(log: Path, output: Path, as_json: bool, **options: Any) -> int:
    """Fit a linear model with its resonances to a recording (response file) or to a frf.json of `rrrgen frf`.

    auto fits modes to the frequency response where the recording has an excitation beside the input (a closed loop),
    and otherwise a difference equation: ARX, ARMAX or output error. Orders are chosen within the rows to fit. Several
    postures get a model each. Writes results/response_model.json, C of one step of the model in state space, and
    figures. Exits with 1 where the response of a posture cannot be trusted.

    --robot and --experiment, the file that `rrrgen simulate --response` reads, print the resonances that the mass
    matrix of the robot and the elastic joints and base of the experiment lead to beside the measured ones.

    \b
    Example:
      rrrgen response-model runs/response/results/frf.json -o runs/model
      rrrgen response-model arm.yaml --fit-rows 1:512 -o runs/model
    """
    require("rrrgen response-model", "scipy", "matplotlib")
    from rrrgen.emit.c.function_files import function_files
    from rrrgen.lab.data.run_folder import RunFolder, plain
    from rrrgen.lab.response.figures import plot_models, plot_resonances
    from rrrgen.lab.response.fitting import fit_recordings, fit_responses
    from rrrgen.lab.response.response_file import load_response

    rows, method = options["fit_rows"], options["method"]
    inputs = {"log": str(log)}
    computed = None
    if (options["robot"] is None) != (options["experiment"] is None):
        raise click.UsageError("--robot and --experiment belong together")
    if options["robot"] is not None:
        computed = _expected(options["robot"], options["experiment"])
        inputs["experiment"] = str(options["experiment"])
    if log.suffix.lower() == ".json":
        from rrrgen.lab.response.frequency_response import read_responses

        if rows is not None or method not in ("auto", "modes"):
            raise click.UsageError("a frequency response has no rows, and takes --method modes")
        with working("fitting the model"):
            found = fit_responses(read_responses(log))
    else:
        response = load_response(log)
        inputs |= {f"file {source.name}": str(source.path) for source in response.files}
        with working("fitting the model"):
            found = fit_recordings(response, rows, method)
    settings = {"fit_rows": rows, "method": method, "real": options["real"]}
    record = found.to_json()
    if computed is not None:
        record["elastic_model"] = _beside(found, computed)
    with RunFolder(output, "response-model", inputs, settings, 0, options["fresh"]) as folder:
        folder.write_json("response_model.json", record)
        for name, text in function_files(
            "response_model", "a linear model", _programs(found.models), options["real"]
        ).items():
            folder.write_text(name, text)
        if found.measured:
            folder.figure("response_model", plot_models(found.measured, found.models))
        if len(found.models) > 1:
            folder.figure("resonances", plot_resonances(found.models))
    if as_json:
        print_json(plain(record))
    else:
        _print(found, record)
    return 1 if found.refused else 0


def _expected(robot: str, file: Path) -> list[list[ElasticMode]]:
    """Compute the vibration modes of the elastic robot of an experiment file, for each of its postures."""
    from rrrgen.cli.arguments import read_with_warnings
    from rrrgen.lab.experiment.elastic_comparison import expected_modes
    from rrrgen.lab.experiment.experiment_file import load_experiment
    from rrrgen.runtime.load import compile

    spec = read_with_warnings(robot)
    return expected_modes(load_experiment(file, spec.n), compile(spec))


def _beside(found: FittedModels, computed: list[list[ElasticMode]]) -> list[dict[str, Any]]:
    """Pair the measured resonances with the computed ones; one entry per computed mode."""
    from rrrgen.base.errors import InputError
    from rrrgen.lab.experiment.elastic_comparison import beside

    names = [each.name for each in found.measured] or [each.name for each in found.models]
    if len(names) != len(computed):
        raise InputError(f"{len(names)} postures are measured, the experiment file has {len(computed)} (`response`)")
    return beside(found.models, dict(zip(names, computed, strict=True)))


def _programs(models: Sequence[ResponseModel]) -> list[Program]:
    """Record one step of every model as a program named ``step``, or ``step_<posture>`` where there are several."""
    from rrrgen.emit.controller.linear_step import linear_step_program

    programs, names = [], set[str]()
    for model in models:
        name = re.sub(r"\W", "_", f"step_{model.name}") if len(models) > 1 else "step"
        while name in names:
            name += "_"
        names.add(name)
        title = f"the linear model of {model.name}" if len(models) > 1 else "a linear model"
        programs.append(linear_step_program([model.state_space()], model.period, name, title))
    return programs


def _print(found: FittedModels, record: dict[str, Any]) -> None:
    """Print the orders, scores and resonances of the models."""
    for model in found.models:
        _print_model(model)
    for mode in found.overlooked:
        say(f"not in the model: {_told(mode)}, which the frequency response shows; --method modes fits it")
    for name, reason in found.refused.items():
        say(f"no model of {name}: {reason}")
    for mode in record.get("resonances_over_postures", ()):
        (low, high), (least, most) = mode["frequency"], mode["damping"]
        say(f"over {len(mode['postures'])} postures: {low:.4g} to {high:.4g} Hz, damping {least:.3g} to {most:.3g}")
    for row in record.get("elastic_model", ()):
        computed, measured = row["computed"], row["measured"]
        told = "no resonance measured"
        if measured is not None:
            told = (
                f"measured {measured['frequency']:.4g} Hz, {measured['damping']:.3g} ({100 * row['deviation']:.2g} %)"
            )
        say(
            f"{row['posture']}: M(q) and stiffness give {computed['frequency']:.4g} Hz, damping "
            f"{computed['damping']:.3g}, a peak of {computed['peak']:.2g}; {told}"
        )


def _print_model(model: ResponseModel) -> None:
    fit = model.fit
    say(f"{model.name}: {model.method}, order {len(model.a)}, delay {model.delay} samples")
    say(f"fit {fit['value']:.2f} %: {fit['protocol']}")
    for key, other in OTHER_PROTOCOLS.items():
        if key in fit and fit[key] != fit["value"]:
            say(f"  {fit[key]:.2f} %: {other}")
    if "scored_rows" in fit:
        first, last = fit["scored_rows"]
        say(f"  scored on rows {first}:{last}{'' if fit['held_out'] else ', which were fitted'}")
    if model.rounding > COARSE:
        say(
            f"  a and b, in double precision, hold the response to {100.0 * model.rounding:.2g} %: take the state space"
        )
    for mode in model.resonances:
        say(f"  resonance {_told(mode)}")
    say("candidates:")
    say(*text_table(_candidates(model.table), terminal_width()))


def _candidates(table: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """The rows of the table of models that were compared, below their headings."""
    keys = list(dict.fromkeys(key for row in table for key in row))
    values = ([row.get(key, "-") for key in keys] for row in table)
    rows = (tuple(f"{v:.5g}" if isinstance(v, float) else str(v) for v in row) for row in values)
    return [tuple(key.replace("_", " ") for key in keys), *rows]


def _told(mode: Resonance) -> str:
    frequency, damping = (
        f"{value:.4g} +- {std:.2g}" if std is not None else f"{value:.4g}"
        for value, std in ((mode.frequency, mode.frequency_std), (mode.damping, mode.damping_std))
    )
    doubt = f" ({' and '.join(mode.uncertain)} hardly known: record longer)" if mode.uncertain else ""
    return f"{frequency} Hz, damping {damping}{doubt}"
