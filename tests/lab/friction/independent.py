"""The friction study on recordings of an independent plant with known truth, each parameter against its limit.

    python tests/lab/friction/independent.py --case "stribeck, degrees" --seeds 3

The plant, its controller and its laws are those of ``tests/oracles/sliding_joint.c``; the recordings go through files
with their units, columns and signs. For every case it prints the laws chosen and, of the true law, the largest error of
each parameter over the seeds, its limit, the errors in reported standard deviations (rms), and the notes of the
command. Exits with 1 if a law or a limit is missed; ``warned`` marks a miss of which a note of the command warns.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from lab.friction.independent_cases import CASES, Case, reference, write
from oracles.sliding_joint import simulate

LIMITS = {
    "inertia": 0.01, "coulomb": 0.02, "coulomb_p": 0.02, "coulomb_n": 0.02, "viscous": 0.05, "viscous_p": 0.05,
    "viscous_n": 0.05, "stiction_excess": 0.1, "stribeck_speed": 0.1,
}  # fmt: skip
GRAVITY_LIMIT = 0.01


def run_case(case: Case, seed: int, folder: Path, options: tuple[str, ...] = ()) -> dict[str, Any]:
    """The record ``friction.json`` of the command on the recording of this case, made in ``folder``."""
    from rrrgen.cli.main import run

    log = write(folder, case, simulate(case.joint, case.loop, reference(case, seed), seed))
    command = [
        "experiment",
        "friction",
        case.robot,
        "--log",
        log,
        "--joint",
        case.moving,
        "-o",
        folder / "run",
        "--json",
        *options,
    ]
    with redirect_stdout(StringIO()) as printed, redirect_stderr(StringIO()) as complaint:
        code = run([str(word) for word in command])
    if code:
        return {"chosen": f"exit {code}: {complaint.getvalue().strip()}", "models": {}, "notes": []}
    return json.loads(printed.getvalue())


def errors(case: Case, record: dict[str, Any]) -> dict[str, tuple[float, float, float | None]]:
    """Of every parameter of the true law: relative error, error in deviations, limit or None."""
    model, truth, found = record["models"].get(case.joint.law), case.joint.truth(), {}
    for name, value in (model["parameters"] if model else {}).items():
        if not truth.get(name):
            continue
        limit = LIMITS.get(name)
        if name == "gravity" and not (case.joint.constant and case.joint.gravity):
            limit = GRAVITY_LIMIT
        error = abs(value - truth[name])
        found[name] = (error / abs(truth[name]), error / model["std"][name], limit)
    return found


def curve_error(case: Case, record: dict[str, Any]) -> float:
    """Relative error of the friction curve of the chosen neural law over the speeds of the recording."""
    given = record["models"]["neural"]["parameters"]
    v = np.linspace(-2.0, 2.0, 400) * case.fast
    units = range(1, 1 + sum(name.startswith("w") for name in given))
    found = given["viscous"] * v + sum(given[f"f{k}"] * np.tanh(given[f"w{k}"] * v) for k in units)
    truth = case.joint.friction(v)
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def shortened(case: Case) -> Case:
    """The case with a recording of 20 s at 500 Hz at most: a quarter of the time to fit, and a harder task."""
    return replace(case, seconds=20.0, loop=replace(case.loop, period=max(2e-3, case.loop.period)))


def _one(name: str, seed: int, quick: bool) -> dict[str, Any]:
    case = shortened(CASES[name]) if quick else CASES[name]
    with tempfile.TemporaryDirectory() as folder:
        return run_case(case, seed, Path(folder))


def report(name: str, records: list[dict[str, Any]]) -> int:
    """Print the table of one case; returns the number of misses."""
    case, law = CASES[name], CASES[name].joint.law
    chosen = [record["chosen"] for record in records]
    missed = sum(each != law for each in chosen)
    print(f"{name}: {len(records) - missed} of {len(records)} times {law}; chosen: {', '.join(chosen)}")
    tables = [errors(case, record) for record in records]
    for parameter in dict.fromkeys(key for table in tables for key in table):
        rows = [(table[parameter], record["notes"]) for table, record in zip(tables, records, strict=True) if table]
        worst = max(row[0] for row, _ in rows)
        deviations = float(np.sqrt(np.mean([row[1] ** 2 for row, _ in rows])))
        limit = rows[0][0][2]
        over = [notes for row, notes in rows if limit is not None and row[0] > limit]
        told = "" if limit is None else f"  limit {100 * limit:g} %"
        if over:
            warned = all(any(parameter in note for note in notes) for notes in over)
            told += "  MISSED, warned" if warned else "  MISSED"
        missed += len(over)
        print(f"  {parameter:<16} {100 * worst:8.3f} %  {deviations:6.1f} deviations{told}")
    if law == "neural" and all(record["models"] for record in records):
        print(f"  friction curve   {100 * max(curve_error(case, record) for record in records):8.3f} %")
    for note in dict.fromkeys(note for record in records for note in record["notes"]):
        print(f"  note: {note}")
    sys.stdout.flush()
    return missed


def main() -> int:
    """Run the study and print its tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1, help="recordings per case")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--case", action="append", choices=list(CASES), help="case to run; repeat for several")
    parser.add_argument("--quick", action="store_true", help="20 s at 500 Hz instead of 40 s at the rate of the case")
    given = parser.parse_args()
    names = given.case or list(CASES)
    with ProcessPoolExecutor(given.jobs) as pool:
        runs = {name: [pool.submit(_one, name, seed, given.quick) for seed in range(given.seeds)] for name in names}
        missed = sum(report(name, [each.result() for each in futures]) for name, futures in runs.items())
    print(f"{missed} missed")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
