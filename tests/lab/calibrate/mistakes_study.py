"""Study of the diagnosis of mistaken files: how often the mistake is named rightly, not decided, or named wrongly.

``python -m tests.lab.calibrate.mistakes_study`` prints a line for each robot and number of poses, and ends with
the exit code 1 if a mistake is named wrongly or a file without one is refused. Mistakes are drawn from those that
:mod:`rrrgen.lab.calibrate.diagnosis` knows and from others, which must not be given a name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.calibrate.diagnosis import estimate_checked
from rrrgen.lab.calibrate.measurements import read_table
from rrrgen.robot.file import load_spec
from tests.lab.calibrate.virtual import ANGLE_NOISE, NOISE, measure, off_the_table, positions

Columns = dict[str, np.ndarray]
Change = Callable[[Columns, np.random.Generator], str]
"""Spoils columns in place; returns what the message must say, "" where the mistake is none that has a name."""


def poses_as_columns(q: np.ndarray, T: np.ndarray) -> Columns:
    """The columns of a file of poses with roll, pitch and yaw."""
    R = T[:, :3, :3]
    columns = {f"q{k + 1}": q[:, k].copy() for k in range(q.shape[1])}
    columns |= {name: T[:, k, 3].copy() for k, name in enumerate("xyz")}
    columns |= {"roll": np.arctan2(R[:, 2, 1], R[:, 2, 2]), "pitch": -np.arcsin(np.clip(R[:, 2, 0], -1, 1))}
    return columns | {"yaw": np.arctan2(R[:, 1, 0], R[:, 0, 0])}


def write(file: Path, columns: Columns) -> None:
    """Write columns as a file of measurements."""
    rows = "\n".join(",".join(repr(float(x)) for x in row) for row in np.column_stack(list(columns.values())))
    file.write_text(",".join(columns) + "\n" + rows + "\n", encoding="utf-8")


def _exchange(columns: Columns, a: str, b: str) -> str:
    columns[a], columns[b] = columns[b], columns[a]
    return f"the columns {a} and {b} exchanged"


def _scaled(columns: Columns, names: list[str], factor: float, said: str) -> str:
    for name in names:
        columns[name] = columns[name] * factor
    return said


def _joints(columns: Columns) -> list[str]:
    return [name for name in columns if name.startswith("q")]


def _two(columns: Columns, random: np.random.Generator, names: list[str]) -> str:
    a, b = sorted(random.choice(len(names), 2, replace=False))
    return _exchange(columns, names[a], names[b])


def _one_joint(columns: Columns, random: np.random.Generator) -> str:
    name = str(random.choice(_joints(columns)))
    return _scaled(columns, [name], -1.0, f"fit with {name} reversed")


def _shifted(columns: Columns, random: np.random.Generator) -> str:
    name = str(random.choice(_joints(columns)))
    columns[name] = np.roll(columns[name], 1)
    return ""


def _two_mistakes(columns: Columns, random: np.random.Generator) -> str:
    _two(columns, random, _joints(columns))
    _two(columns, random, list("xyz"))
    return ""


MISTAKES: dict[str, Change] = {
    "position columns": lambda c, r: _two(c, r, list("xyz")),
    "joint columns": lambda c, r: _two(c, r, _joints(c)),
    "reversed joint": _one_joint,
    "reversed position": lambda c, r: _scaled(c, ["y"], -1.0, "fit with y reversed"),
    "mm": lambda c, r: _scaled(c, list("xyz"), 1e3, "lengths in mm"),
    "inches": lambda c, r: _scaled(c, list("xyz"), 1 / 0.0254, "lengths in inches"),
    "degrees": lambda c, r: _scaled(c, _joints(c), 180 / np.pi, "joint positions in deg"),
    "angles in degrees": lambda c, r: _scaled(c, ["roll", "pitch", "yaw"], 180 / np.pi, "rotation angles in deg"),
    "angle columns": lambda c, r: _exchange(c, "roll", "yaw").replace("the columns roll and yaw exchanged",
                                                                       "in the order yaw, pitch, roll"),
    "a column of other rows": _shifted,
    "two mistakes": _two_mistakes,
    "none": lambda c, r: "calibrated",
}  # fmt: skip


def outcome(robot: str, mistake: str, count: int, seed: int, folder: Path) -> str:
    """``right``, ``cannot tell`` or ``wrong`` for one random file of ``count`` poses."""
    spec, random = load_spec(robot), np.random.default_rng([seed, count, list(MISTAKES).index(mistake)])
    nominal, true = off_the_table(spec, random)
    q = positions(spec, count, random)
    columns = poses_as_columns(q, measure("pose", true, q, random).values)
    wanted = MISTAKES[mistake](columns, random)
    write(folder / "m.csv", columns)
    table = read_table(folder / "m.csv", [f"q{k + 1}" for k in range(spec.n)])
    try:
        found = estimate_checked(nominal, table.measurements(NOISE, ANGLE_NOISE), table)
        said = "calibrated" if found.chi2_per_dof < 2 else f"calibrated, chi^2 {found.chi2_per_dof:.1g}"
    except (InputError, DerivationError) as error:
        said = str(error)
    if wanted and wanted in said and "cannot tell" not in said:
        return "right"
    undecided = ("cannot tell", "compare units", "calibrated, chi^2", "do not determine", "aside as outliers")
    return "cannot tell" if any(part in said for part in undecided) else f"wrong: {said}"


@click.command()
@click.option("--seeds", default=5, show_default=True, help="Number of seeds per robot, mistake and number of poses.")
@click.option("--robot", "robots", multiple=True, default=("rrr", "ur10e", "puma560"), show_default=True)
@click.option("--poses", "counts", multiple=True, type=int, default=(8, 12, 16, 30, 50), show_default=True)
@click.option("--mistake", "only", multiple=True, type=click.Choice(list(MISTAKES)), help="Only this one.")
def study(seeds: int, robots: tuple[str, ...], counts: tuple[int, ...], only: tuple[str, ...]) -> int:
    """Count right, undecided and wrong diagnoses; exit with 1 if one is wrong."""
    wrong = 0
    with TemporaryDirectory() as name:
        for robot in robots:
            for count in counts:
                total: Counter[str] = Counter()
                undecided: Counter[str] = Counter()
                for mistake in only or MISTAKES:
                    for seed in range(seeds):
                        result = outcome(robot, mistake, count, seed, Path(name))
                        total[result.partition(":")[0]] += 1
                        undecided[mistake] += result == "cannot tell"
                        if result.startswith("wrong"):
                            click.echo(f"{robot}, {mistake}, {count} poses, seed {seed}: {result}")
                wrong += total["wrong"]
                open_ones = ", ".join(f"{mistake} {number}" for mistake, number in undecided.items() if number)
                figures = ", ".join(f"{what} {total[what]}" for what in ("right", "cannot tell", "wrong"))
                click.echo(f"{robot:9} {count:3} poses: {figures}" + (f" ({open_ones})" if open_ones else ""))
    return 0 if wrong == 0 else 1


if __name__ == "__main__":
    raise SystemExit(study(standalone_mode=False))
