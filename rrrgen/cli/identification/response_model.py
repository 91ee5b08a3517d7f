"""``rrrgen response-model``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.cli.arguments import json_option, print_json, real_option
from rrrgen.cli.identification.workflow import output_option
from rrrgen.extras import require

if TYPE_CHECKING:
    from rrrgen.response.frequency_response import FrequencyResponse
    from rrrgen.response.response_file import ResponseFile
    from rrrgen.response.response_model import ResponseModel

METHODS = ("auto", "modes", "arx", "output_error", "indirect")
CURVE = 2000  # points of the model's curve in the figure


def _rows(ctx: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """``A:B`` as two row numbers."""
    if value is None:
        return None
    match = re.fullmatch(r"\s*(\d+)\s*:\s*(\d+)\s*", value)
    if match is None or not 1 <= int(match[1]) < int(match[2]):
        raise click.BadParameter(f"'{value}' is no range of rows, e.g. 1:512; rows count from 1", ctx, parameter)
    return int(match[1]), int(match[2])


@click.command(name="response-model")
@click.argument("log", type=click.Path(path_type=Path), metavar="LOG_OR_FRF")
@output_option
@click.option("--fit-rows", callback=_rows, metavar="A:B", help="Rows to fit, from 1; the others test the model.")
@click.option("--method", type=click.Choice(METHODS), default="auto", show_default=True, help="Kind of model.")
@real_option
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def response_model(log: Path, output: Path, as_json: bool, **options: Any) -> int:
    """Fit a linear model with its resonances to a recording (response file) or to a frf.json of `rrrgen frf`.

    auto fits modes to the frequency response where the recording has an excitation beside the input (a closed loop),
    and otherwise a difference equation: ARX or output error. Orders are chosen within the rows to fit. Writes
    results/response_model.json, C of one step of the model, and a figure.

    \b
    Example:
      rrrgen response-model runs/response/results/frf.json -o runs/model
      rrrgen response-model arm.yaml --fit-rows 1:512 -o runs/model
    """
    require("rrrgen response-model", "scipy", "matplotlib")
    import numpy as np

    from rrrgen.backends.c.functions import function_files
    from rrrgen.control.difference_equation import difference_equation_program
    from rrrgen.response.modal_fit import fit_modes
    from rrrgen.response.plots import plot_responses
    from rrrgen.response.response_file import load_response
    from rrrgen.runs.run_folder import RunFolder, plain

    rows, method = options["fit_rows"], options["method"]
    inputs = {"log": str(log)}
    measured: list[FrequencyResponse] = []
    if log.suffix.lower() == ".json":
        from rrrgen.response.frequency_response import read_frf

        if rows is not None or method not in ("auto", "modes"):
            raise click.UsageError("a frequency response has no rows, and takes --method modes")
        measured = [read_frf(log)]
        model = fit_modes(measured[0])
    else:
        response = load_response(log)
        inputs |= {f"file {source.name}": str(source.path) for source in response.files}
        model, measured = _of_recording(response, rows, method)
    settings = {"fit_rows": rows, "method": method, "real": options["real"]}
    step = difference_equation_program(model.numerator.tolist(), model.denominator.tolist(), model.period)
    with RunFolder(output, "response-model", inputs, settings, 0, options["fresh"]) as folder:
        folder.write_json("response_model.json", model.to_json())
        for name, text in function_files("response_model", "a linear model", [step], options["real"]).items():
            folder.write_text(name, text)
        if measured:
            frequency = np.geomspace(measured[0].frequency[0], measured[0].frequency[-1], CURVE)
            folder.figure("response_model", plot_responses(measured, [("model", frequency, model.response(frequency))]))
    if as_json:
        print_json(plain(model.to_json()))
    else:
        _print(model)
    return 0


def _of_recording(
    response: ResponseFile, rows: tuple[int, int] | None, method: str
) -> tuple[ResponseModel, list[FrequencyResponse]]:
    """The model of the first recording, and its frequency response where there is one."""
    from rrrgen.errors import DerivationError
    from rrrgen.response.difference_models import fit_difference_model
    from rrrgen.response.estimate import estimate_one
    from rrrgen.response.modal_fit import fit_modes
    from rrrgen.response.response_file import read_recordings

    records = read_recordings(response)
    if len(records) > 1:
        raise click.UsageError("several recordings: fit the frf.json of `rrrgen frf`, or name one file in LOG")
    record = records[0]
    closed = response.excitation is not None and bool((record.n != record.u).any())
    if method == "modes" or (method == "auto" and closed and rows is None):
        found = estimate_one(record, response.period)
        return fit_modes(found), [found]
    model = fit_difference_model(record, rows, method, response.controller)
    try:
        return model, [estimate_one(record, response.period)]
    except DerivationError:  # too short for a frequency response to show beside the model
        return model, []


def _print(model: ResponseModel) -> None:
    """Order, score and resonances in words."""
    fit = model.fit
    click.echo(f"{model.method}: order {len(model.a)}, delay {model.delay} samples")
    click.echo(f"fit {fit['value']:.2f} %: {fit['protocol']}")
    if "scored_rows" in fit:
        first, last = fit["scored_rows"]
        click.echo(f"  scored on rows {first}:{last}{'' if fit['held_out'] else ', which were fitted'}")
    for mode in model.resonances:
        told = [
            f"{value:.4g} +- {std:.2g}" if std is not None else f"{value:.4g}"
            for value, std in ((mode.frequency, mode.frequency_std), (mode.damping, mode.damping_std))
        ]
        click.echo(f"  resonance {told[0]} Hz, damping {told[1]}")
    click.echo("candidates:")
    for row in model.table:
        click.echo(
            "  " + "  ".join(f"{key} {v:.5g}" if isinstance(v, float) else f"{key} {v}" for key, v in row.items())
        )
