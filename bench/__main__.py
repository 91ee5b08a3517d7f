"""``python -m bench``: the command line of the benchmark."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrrgen.cli.arguments import complete_robot, json_option, print_json
from rrrgen.cli.main import main
from rrrgen.cli.terminal import progress_bar

if TYPE_CHECKING:
    from bench.results import Results

PARTS = ("functions", "python", "ik", "growth", "generation", "control", "mechanisms", "hessians")


@click.command()
@click.argument("robots", nargs=-1, shell_complete=complete_robot, metavar="[ROBOT]...")
@click.option("--quick", is_flag=True, help="Fewer and shorter samples, shorter chains.")
@click.option("--only", type=click.Choice(PARTS), multiple=True, help="Run only this part; repeat for several.")
@click.option("--flags", default="-O3 -march=native", show_default=True, help="Compiler flags for all contenders.")
@click.option(
    "--pinocchio/--no-pinocchio", default=True, help="Include Pinocchio; compiling its headers takes minutes."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("bench/results"),
    show_default=True,
    help="Directory for benchmark.json, benchmark.md and the plots.",
    metavar="DIR",
)
@json_option
def bench(
    robots: tuple[str, ...],
    quick: bool,
    only: tuple[str, ...],
    flags: str,
    pinocchio: bool,
    output: Path,
    as_json: bool,
) -> int:
    """Compare emitted C with Pinocchio, hand-written CasADi and EAIK, as far as they are installed.

    Everything is built with the same compiler and flags, checked against independent dynamics, and measured
    alternately: nanoseconds, instructions, operation counts, calls from Python, batches, inverse kinematics, growth
    with the number of joints. Without ROBOT, the four robots of the published table are measured.

    \b
    Examples:
      python -m bench --quick
      python -m bench rrr --only functions
      CC=clang python -m bench -o clang_results
    """
    from bench.contenders.cases import ROBOTS
    from bench.page import page
    from bench.session import Plan
    from bench.session import bench as run_bench

    parts = frozenset(only or PARTS)
    plan = Plan(robots or ROBOTS, quick, tuple(flags.split()), pinocchio, parts)
    with progress_bar() as draw:  # drawn between measurements only

        def tell(done: int, total: int, message: str) -> None:
            draw(done, total, message)
            if not sys.stderr.isatty():
                click.echo(message, err=True)

        results = run_bench(plan, tell)
    output.mkdir(parents=True, exist_ok=True)
    (output / "benchmark.json").write_text(json.dumps(results.as_dict(), indent=1) + "\n", encoding="utf-8")
    (output / "benchmark.md").write_text(page(results), encoding="utf-8")
    _draw(results, output)
    if as_json:
        print_json(results.as_dict())
    else:
        _print(results)
    return 0


def _draw(results: Results, output: Path) -> None:
    from importlib.util import find_spec

    if not results.scores:
        return
    if find_spec("matplotlib") is None:
        click.echo("matplotlib is not installed: no plot", err=True)
        return
    from bench.plot import plot

    plot(results, output)


def _print(results: Results) -> None:
    from bench.targets import verdicts

    for score in results.scores:
        contender, count = score.contender, score.instructions
        counted = "" if contender.operations is None else f"{contender.operations['mul']}/{contender.operations['add']}"
        instructions = "-" if count is None else f"{count:.0f}"
        click.echo(
            f"{score.robot:9} {contender.function:22} {contender.label:26} {score.nanoseconds:9.1f} ns "
            f"{instructions:>8} instr {counted:>9}"
        )
    for tick in results.ticks:
        click.echo(f"{tick.robot:9} {tick.work:49} {tick.nanoseconds:9.1f} ns {tick.parameters:8} parameters")
    for each in results.mechanisms:
        ratio = each.pinocchio / each.nanoseconds
        click.echo(
            f"{each.robot:18} {each.function:20} {each.nanoseconds:9.1f} ns, Pinocchio {ratio:5.1f} times as much"
        )
    for second in results.hessians:
        rivals = {"CasADi": second.casadi, "Pinocchio": second.pinocchio}
        theirs = (f", {name} {time / second.nanoseconds:5.1f} times as much" for name, time in rivals.items() if time)
        click.echo(f"{second.robot:9} {second.function:38} {second.nanoseconds:9.1f} ns{''.join(theirs)}")
    for text in results.left_out:
        click.echo(f"left out: {text}", err=True)
    for verdict in verdicts(results):
        mark = "met   " if verdict.met else "MISSED"
        click.echo(f"{mark} {verdict.robot:9} {verdict.work:52} {verdict.target:>12}   {verdict.found}")


if __name__ == "__main__":
    main(prog_name="python -m bench", command=bench)
