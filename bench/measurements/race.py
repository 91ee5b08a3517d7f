"""One executable per robot with every contestant in it; its values, times and instruction counts."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.contestants.cases import Case
from bench.contestants.contestant import TITLES, Contestant, DisagreementError, Party, deviation
from bench.templates import source
from bench.toolchain import Toolchain
from rrrgen.errors import BuildError
from rrrgen.verify.references.chain import Array

TOLERANCE = 1e-9
"""Largest relative deviation: round-off of thousands of operations, and the condition of random mass matrices."""


@dataclass(frozen=True)
class Effort:
    """How long to measure: rounds of turns, nanoseconds per sample, states whose instructions are counted."""

    rounds: int = 120
    sample: float = 3e4
    counted: int = 2


QUICK = Effort(rounds=25, sample=2e4, counted=1)


@dataclass(frozen=True)
class Score:
    """What one contestant did on one robot."""

    robot: str
    contestant: Contestant
    deviation: float
    nanoseconds: float
    instructions: float | None


@dataclass(frozen=True)
class Driver:
    """The executable, its contestants and its states."""

    place: Path
    contestants: Sequence[Contestant]
    states: Array

    @classmethod
    def build(
        cls,
        place: Path,
        contestants: Sequence[Contestant],
        sources: Mapping[str, str],
        declarations: str,
        states: Array,
        toolchain: Toolchain,
        setup: str = "",
        cpp: Sequence[tuple[str, str, tuple[str, ...]]] = (),
    ) -> Driver:
        """Compile and link in ``place``, which must outlive the driver."""
        headers = {name: text for name, text in sources.items() if name.endswith(".h")}
        objects = [toolchain.object(name, text, headers) for name, text in sources.items() if name.endswith(".c")]
        objects += [toolchain.object(name, source, {}, includes) for name, source, includes in cpp]
        own = _header(contestants)
        table = _table(contestants, declarations, setup)
        objects.append(toolchain.object("contestants.c", table, {**headers, "contestants.h": own}))
        objects.append(toolchain.object("driver.c", source("driver.c"), {"contestants.h": own}))
        toolchain.link(objects, place / "driver", bool(cpp))
        values = np.ascontiguousarray(states, dtype=float)
        (place / "states").write_bytes(np.array(values.shape, dtype=np.int64).tobytes() + values.tobytes())
        return cls(place, contestants, values)

    def values(self) -> list[Array]:
        """What every contestant returns: (states, outputs) each."""
        self._run("evaluate", str(self.place / "values"))
        flat = np.fromfile(self.place / "values")
        sizes = [len(self.states) * contestant.outputs for contestant in self.contestants]
        return [part.reshape(len(self.states), -1) for part in np.split(flat, np.cumsum(sizes)[:-1])]

    def times(self, effort: Effort) -> dict[int, float]:
        """Least nanoseconds per call of every contestant."""
        return _lines(self._run("time", str(effort.rounds), str(effort.sample)))

    def instructions(self, states: int) -> dict[int, float]:
        """Mean instructions per call over the first ``states`` states; empty where processes cannot be stepped."""
        return _lines(self._run("count", str(states), may_fail=True))

    def _run(self, mode: str, *arguments: str, may_fail: bool = False) -> str:
        command = [str(self.place / "driver"), mode, str(self.place / "states"), *arguments]
        environment = {**os.environ, "LD_BIND_NOW": "1"}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600, check=False)
        if done.returncode and not may_fail:
            raise BuildError(f"the driver failed in '{mode}' (exit {done.returncode}): {done.stderr}")
        return done.stdout if done.returncode == 0 else ""


def race(case: Case, parties: Sequence[Party], toolchain: Toolchain, effort: Effort) -> list[Score]:
    """Build, check and measure. Raises DisagreementError where a contestant computes something else."""
    order = list(TITLES)
    contestants = sorted(
        (contestant for party in parties for contestant in party.contestants),
        key=lambda contestant: order.index(contestant.function),
    )
    sources = {name: text for party in parties for name, text in party.sources.items()}
    declarations = "".join(party.declarations for party in parties)
    setup = " ".join(party.setup for party in parties)
    cpp = [party.cpp for party in parties if party.cpp]
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        driver = Driver.build(
            Path(place), contestants, sources, declarations, case.states, toolchain, setup=setup, cpp=cpp
        )
        deviations = _checked(case, contestants, driver.values())
        times, counts = driver.times(effort), driver.instructions(effort.counted)
    return [
        Score(case.name, contestant, deviations[k], times[k], counts.get(k)) for k, contestant in enumerate(contestants)
    ]


def _checked(case: Case, contestants: Sequence[Contestant], values: Sequence[Array]) -> list[float]:
    deviations = []
    for contestant, result in zip(contestants, values, strict=True):
        deviations.append(deviation(contestant, result, case))
        if not deviations[-1] < TOLERANCE:
            raise DisagreementError(
                f"{case.name}: {contestant.function} of {contestant.label} differs from the reference by "
                f"{deviations[-1]:.1e} (at most {TOLERANCE:.0e} is allowed); nothing is timed"
            )
    return deviations


def _header(contestants: Sequence[Contestant]) -> str:
    return (
        f"#define CONTESTANTS {len(contestants)}\n#define MAX_OUTPUT {max(c.outputs for c in contestants)}\n"
        "struct contestant { int group, outputs; void (*run)(const double *, double *); };\n"
        "extern const struct contestant contestants[CONTESTANTS];\nvoid contestants_setup(void);\n"
    )


def _table(contestants: Sequence[Contestant], declarations: str, setup: str) -> str:
    functions = list(dict.fromkeys(contestant.function for contestant in contestants))
    lines = ['#include "contestants.h"', declarations]
    for k, contestant in enumerate(contestants):
        lines.append(f"static void run{k}(const double *in, double *out) {{ {contestant.statements} }}")
    rows = [f"    {{{functions.index(c.function)}, {c.outputs}, run{k}}}," for k, c in enumerate(contestants)]
    lines += ["const struct contestant contestants[CONTESTANTS] = {", *rows, "};"]
    return "\n".join([*lines, f"void contestants_setup(void) {{ {setup} }}", ""])


def _lines(text: str) -> dict[int, float]:
    return {int(key): float(value) for key, value in (line.split() for line in text.splitlines())}
