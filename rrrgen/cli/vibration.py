"""The command ``rrrgen response vibration``: design input shapers and notch filters against measured vibrations."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.errors import require
from rrrgen.cli.arguments import Number, json_option, output_option, print_json, real_option, refuse
from rrrgen.cli.terminal import say

if TYPE_CHECKING:
    from rrrgen.lab.vibration import Notch, Shaper, Vibration

SHAPERS = ("auto", "zv", "zvd", "ei", "none")
AGAINST = ("resonances", "antiresonances")


def _modes(ctx: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> tuple[tuple[float, float], ...]:
    """Parse the option ``--mode HZ:DAMPING``, which may be repeated, to pairs (frequency in Hz, damping ratio)."""
    modes = []
    for value in values:
        match = re.fullmatch(r"\s*([0-9.]+(?:[eE][-+]?\d+)?)\s*:\s*([0-9.]+(?:[eE][-+]?\d+)?)\s*", value)
        try:
            modes.append((float(match[1]), float(match[2])) if match else None)
        except ValueError:
            modes.append(None)
        if modes[-1] is None:
            raise click.BadParameter(f"'{value}' is no mode, e.g. 28:0.05 for 28 Hz and damping 0.05", ctx, parameter)
    return tuple(mode for mode in modes if mode is not None)


@click.command()
@click.argument("model", required=False, type=click.Path(path_type=Path))
@output_option
@click.option(
    "--mode",
    "modes",
    multiple=True,
    callback=_modes,
    metavar="HZ:DAMPING",
    help="Mode in place of MODEL: frequency and damping ratio; repeat for more.",
)
@click.option("--rate", type=Number(min=0.0, min_open=True), metavar="HZ", help="Sampling rate, with --mode.")
@click.option(
    "--against",
    type=click.Choice(AGAINST),
    default=AGAINST[0],
    show_default=True,
    help="Which modes of MODEL to suppress.",
)
@click.option("--band", nargs=2, type=Number(), metavar="LOW HIGH", help="Only the modes of MODEL in this band, Hz.")
@click.option(
    "--shaper",
    "kind",
    type=click.Choice(SHAPERS),
    default=SHAPERS[0],
    show_default=True,
    help="Kind of input shaper; auto takes the shortest.",
)
@click.option(
    "--tolerance",
    type=Number(0.0, 0.5, min_open=True, max_open=True),
    default=0.05,
    show_default=True,
    help="Vibration that a shaper may leave, relative.",
)
@click.option("--notch/--no-notch", default=True, show_default=True, help="Also design notch filters.")
@click.option(
    "--peak",
    type=Number(0.0, min_open=True),
    default=3.0,
    show_default=True,
    help="Amplification of a mode that its notch may leave.",
)
@click.option(
    "--width",
    type=Number(0.0, 1.0, min_open=True),
    help="Damping ratio of the notches' poles; default: as the postures and --peak need.",
)
@click.option(
    "--crossover",
    type=Number(0.0, min_open=True),
    metavar="HZ",
    help="Print the phase lag of the notches at this frequency.",
)
@real_option
@click.option("--fresh", is_flag=True, help="Start over in a folder of another run.")
@json_option
def vibration(model: Path | None, output: Path, as_json: bool, **options: Any) -> int:
    """Design input shapers and notch filters against measured vibrations, and write them as C.

    MODEL is a response_model.json of `rrrgen response model`, which has every mode with its range over the postures;
    without it, state the modes by --mode and --rate. The default shaper is the shortest one, ZV or EI, that leaves less
    than the tolerance in all postures; a notch is as narrow as the postures and --peak allow. Writes
    vibration_shaper.h/.c, whose state the caller keeps, vibration_notch.h/.c, vibration.json and a figure. Exits with 1
    where a shaper leaves more than the tolerance.

    A reference that a stiff loop follows excites the antiresonances, in which the links vibrate against standing
    drives; an input of the plant excites its resonances: see docs/vibration.md.

    \b
    Example:
      rrrgen response vibration runs/model/results/response_model.json --shaper ei -o runs/vibration
      rrrgen response vibration --mode 28:0.1 --mode 96:0.02 --rate 1000 -o runs/vibration
    """
    require("rrrgen response vibration", "scipy", "matplotlib")
    from rrrgen.lab.data.run_folder import RunFolder, plain
    from rrrgen.lab.vibration import design_notches, design_shaper, plot_vibration

    kind, tolerance = options["kind"], options["tolerance"]
    if kind == "none" and not options["notch"]:
        raise click.UsageError("nothing to design: neither a shaper nor a notch")
    if kind == "none":
        refuse(["tolerance"], "is that of a shaper, and none is designed")
    if not options["notch"]:
        refuse(["peak", "width", "crossover"], "describes notches, and none is designed")
    if options["width"] is not None:
        refuse(["peak"], "has no effect with --width")
    if options["band"] and options["band"][0] > options["band"][1]:
        raise click.UsageError("--band: {:g} {:g} is in the reverse order, not LOW HIGH".format(*options["band"]))
    if model is None:
        refuse(["against", "band"], "chooses among the modes of MODEL, which is not given")
    vibrations, period, left_out = _vibrations(model, options)
    shaper = None if kind == "none" else design_shaper(vibrations, period, kind, tolerance)
    notches = design_notches(vibrations, period, options["peak"], options["width"]) if options["notch"] else []
    record = _record(vibrations, shaper, notches, period, options["crossover"]) | {"left_out": left_out}
    settings = {name: value for name, value in options.items() if name != "fresh"}
    inputs = {} if model is None else {"model": str(model)}
    with RunFolder(output, "vibration", inputs, settings, 0, options["fresh"]) as folder:
        folder.write_json("vibration.json", record)
        for name, text in _code(shaper, notches, period, options["real"]).items():
            folder.write_text(name, text)
        folder.figure("vibration", plot_vibration(vibrations, shaper, notches, period))
    if as_json:
        print_json(plain(record))
    else:
        _print(record)
    return 1 if any(row.get("left", 0.0) > 1.01 * tolerance for row in record["vibrations"]) else 0


def _vibrations(model: Path | None, options: dict[str, Any]) -> tuple[list[Vibration], float, list[float]]:
    """The vibrations to suppress, from the model file or the options, and the sampling period (s).

    Third the frequencies (Hz) of resonances of which the recording hardly tells that they exist, which are left out.
    """
    from rrrgen.base.errors import DerivationError
    from rrrgen.lab.response.resonances import modes_over_postures
    from rrrgen.lab.response.response_model import read_response_models
    from rrrgen.lab.vibration import Vibration

    if (model is None) != bool(options["modes"]) or (model is None) == (options["rate"] is None):
        raise click.UsageError("give either MODEL, or --mode and --rate")
    if model is None:
        return [Vibration((f,), (damping,)) for f, damping in options["modes"]], 1.0 / options["rate"], []
    models = read_response_models(model)
    against = options["against"]
    left_out = (
        []
        if against != "resonances"
        else [mode.frequency for response_model in models for mode in response_model.resonances if mode.unknown]
    )
    models = [
        replace(response_model, resonances=tuple(m for m in response_model.resonances if not m.unknown))
        for response_model in models
    ]
    vibrations = [
        Vibration(tuple(mode.frequencies.tolist()), tuple(mode.dampings.tolist()))
        for mode in modes_over_postures(models, against)
    ]
    low, high = options["band"] or (0.0, float("inf"))
    chosen = [vibration for vibration in vibrations if low <= vibration.frequency <= high]
    if not chosen:
        others = ", ".join(f"{vibration.frequency:.4g} Hz" for vibration in vibrations) or "none at all"
        raise DerivationError(f"{model} has no {against} between {low:g} and {high:g} Hz; it has {others}")
    return chosen, models[0].period, left_out


def _record(
    vibrations: list[Vibration], shaper: Shaper | None, notches: list[Notch], period: float, crossover: float | None
) -> dict[str, Any]:
    """The contents of vibration.json."""
    from rrrgen.lab.vibration import phase_lag

    rows: list[dict[str, Any]] = []
    for i, vibration in enumerate(vibrations):
        row: dict[str, Any] = {"frequencies": vibration.frequencies, "dampings": vibration.dampings}
        if shaper is not None:
            row |= {"shaper": shaper.kinds[i], "left": shaper.worst_residual(vibration)}
        if notches:
            row |= {"notch": {"width": notches[i].width, "peak": notches[i].peak}}
        rows.append(row)
    record: dict[str, Any] = {"schema": "rrrgen-vibration/1", "sampling_period": period, "vibrations": rows}
    if shaper is not None:
        record["shaper"] = {
            "delays": shaper.delays,
            "weights": shaper.weights,
            "duration": shaper.length * period,
        }
    if notches:
        record["notches"] = [{"numerator": notch.numerator, "denominator": notch.denominator} for notch in notches]
        if crossover is not None:
            record["phase_lag"] = {"frequency": crossover, "degrees": phase_lag(notches, crossover)}
    return record


def _code(shaper: Shaper | None, notches: list[Notch], period: float, real: Any) -> dict[str, str]:
    from rrrgen.emit.c.function_files import function_files
    from rrrgen.emit.controller.filters import linear_step_program, tap_files

    files: dict[str, str] = {}
    if shaper is not None:
        title = f"an input shaper ({', '.join(shaper.kinds)})"
        files |= tap_files("vibration_shaper", title, shaper.delays, shaper.weights, period, real)
    if notches:
        title = f"{len(notches)} notch filter{'s' if len(notches) > 1 else ''}"
        step = linear_step_program([notch.state_space() for notch in notches], period, "step", title)
        files |= function_files("vibration_notch", title, [step], real)
    return files


def _print(record: dict[str, Any]) -> None:
    for row in record["vibrations"]:
        low, high, n = min(row["frequencies"]), max(row["frequencies"]), len(row["frequencies"])
        frequencies = f"{low:.4g} Hz" if low == high else f"{low:.4g} to {high:.4g} Hz in {n} postures"
        parts = [frequencies]
        if "shaper" in row:
            parts.append(f"shaper {row['shaper']} leaves {100 * row['left']:.1f} %")
        if "notch" in row:
            parts.append(f"notch of width {row['notch']['width']:.3g} leaves a peak of {row['notch']['peak']:.3g}")
        say("; ".join(parts))
    for frequency in record["left_out"]:
        say(f"{frequency:.4g} Hz is left out: the recording hardly determines it (--mode states modes)")
    if "shaper" in record:
        say(f"the shaped reference ends {1e3 * record['shaper']['duration']:.4g} ms later")
    if "phase_lag" in record:
        lag = record["phase_lag"]
        say(f"the notches cost {lag['degrees']:.1f} degrees of phase at {lag['frequency']:g} Hz")
