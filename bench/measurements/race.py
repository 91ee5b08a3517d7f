"""The race: one executable per robot that contains every contender, with its values, times and instruction counts."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.contenders.cases import Case
from bench.contenders.contender import TITLES, Contender, DisagreementError, Supplier, deviation
from bench.templates import source
from bench.toolchain import Toolchain
from rrrgen.base.errors import BuildError
from rrrgen.verify.references.numeric_robot import Array

TOLERANCE = 1e-9
"""Largest allowed relative deviation: round-off of thousands of operations, times the condition of random mass
matrices."""


@dataclass(frozen=True)
class Effort:
    """How long to measure: rounds, nanoseconds per sample, number of states whose instructions are counted."""

    rounds: int = 120
    sample: float = 3e4
    counted: int = 2


QUICK = Effort(rounds=25, sample=2e4, counted=1)


@dataclass(frozen=True)
class Score:
    """The result of one contender on one robot."""

    robot: str
    contender: Contender
    deviation: float
    nanoseconds: float
    instructions: float | None


@dataclass(frozen=True)
class Driver:
    """The executable, its contenders and its states."""

    place: Path
    contenders: Sequence[Contender]
    states: Array

    @classmethod
    def build(
        cls,
        place: Path,
        contenders: Sequence[Contender],
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
        own = _header(contenders)
        table = _table(contenders, declarations, setup)
        objects.append(toolchain.object("contenders.c", table, {**headers, "contenders.h": own}))
        objects.append(toolchain.object("driver.c", source("driver.c"), {"contenders.h": own}))
        toolchain.link(objects, place / "driver", bool(cpp))
        values = np.ascontiguousarray(states, dtype=float)
        (place / "states").write_bytes(np.array(values.shape, dtype=np.int64).tobytes() + values.tobytes())
        return cls(place, contenders, values)

    def values(self) -> list[Array]:
        """The values that every contender computes, (states, outputs) each."""
        self._run("evaluate", str(self.place / "values"))
        flat = np.fromfile(self.place / "values")
        sizes = [len(self.states) * contender.outputs for contender in self.contenders]
        return [part.reshape(len(self.states), -1) for part in np.split(flat, np.cumsum(sizes)[:-1])]

    def times(self, effort: Effort) -> dict[int, float]:
        """The smallest time of a call in nanoseconds, by contender."""
        return _lines(self._run("time", str(effort.rounds), str(effort.sample)))

    def instructions(self, states: int) -> dict[int, float]:
        """Mean instructions per call over the first ``states`` states; empty if the system cannot single-step."""
        return _lines(self._run("count", str(states), may_fail=True))

    def _run(self, mode: str, *arguments: str, may_fail: bool = False) -> str:
        command = [str(self.place / "driver"), mode, str(self.place / "states"), *arguments]
        environment = {**os.environ, "LD_BIND_NOW": "1"}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=600, check=False)
        if done.returncode and not may_fail:
            raise BuildError(f"the driver failed in '{mode}' (exit {done.returncode}): {done.stderr}")
        return done.stdout if done.returncode == 0 else ""


def race(case: Case, groups: Sequence[Supplier], toolchain: Toolchain, effort: Effort) -> list[Score]:
    """Build, check and measure all contenders. Raises DisagreementError if one returns wrong values."""
    order = list(TITLES)
    contenders = sorted(
        (contender for group in groups for contender in group.contenders),
        key=lambda contender: order.index(contender.function),
    )
    sources = {name: text for group in groups for name, text in group.sources.items()}
    declarations = "".join(group.declarations for group in groups)
    setup = " ".join(group.setup for group in groups)
    cpp = [group.cpp for group in groups if group.cpp]
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        driver = Driver.build(
            Path(place), contenders, sources, declarations, case.states, toolchain, setup=setup, cpp=cpp
        )
        deviations = _checked(case, contenders, driver.values())
        times, counts = driver.times(effort), driver.instructions(effort.counted)
    return [
        Score(case.name, contender, deviations[k], times[k], counts.get(k)) for k, contender in enumerate(contenders)
    ]


def _checked(case: Case, contenders: Sequence[Contender], values: Sequence[Array]) -> list[float]:
    deviations = []
    for contender, result in zip(contenders, values, strict=True):
        deviations.append(deviation(contender, result, case))
        if not deviations[-1] < TOLERANCE:
            raise DisagreementError(
                f"{case.name}: {contender.function} of {contender.label} differs from the reference by "
                f"{deviations[-1]:.1e} (at most {TOLERANCE:.0e} is allowed); nothing is timed"
            )
    return deviations


def _header(contenders: Sequence[Contender]) -> str:
    return (
        f"#define CONTENDERS {len(contenders)}\n#define MAX_OUTPUT {max(c.outputs for c in contenders)}\n"
        "struct contender { int group, outputs; void (*run)(const double *, double *); };\n"
        "extern const struct contender contenders[CONTENDERS];\nvoid contenders_setup(void);\n"
    )


def _table(contenders: Sequence[Contender], declarations: str, setup: str) -> str:
    functions = list(dict.fromkeys(contender.function for contender in contenders))
    lines = ['#include "contenders.h"', declarations]
    for k, contender in enumerate(contenders):
        lines.append(f"static void run{k}(const double *in, double *out) {{ {contender.statements} }}")
    rows = [f"    {{{functions.index(c.function)}, {c.outputs}, run{k}}}," for k, c in enumerate(contenders)]
    lines += ["const struct contender contenders[CONTENDERS] = {", *rows, "};"]
    return "\n".join([*lines, f"void contenders_setup(void) {{ {setup} }}", ""])


def _lines(text: str) -> dict[int, float]:
    return {int(key): float(value) for key, value in (line.split() for line in text.splitlines())}
