"""Batches of states from NumPy arrays, in turns with single calls of the same function in C."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.contenders.cases import Case
from bench.contenders.contender import DisagreementError
from bench.measurements.python_calls import turns
from bench.measurements.race import TOLERANCE
from bench.toolchain import Toolchain, run
from rrrgen.emit.c.language import Dialect, sincos_strategy
from rrrgen.emit.c.robot_files import header_and_sources
from rrrgen.robot.identity import identify
from rrrgen.verify.references.numeric_robot import Array

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

BATCH = 4096
"""States per batch: their arrays fit the second-level cache of most processors."""

FEW = 64
"""States that the single calls go round: as many as stay next to the processor."""

SAMPLE = 2e-4
"""Seconds per sample, short enough to fall between two disturbances."""

LOOP = """#include "{name}.h"
void calls(const double *q, const double *dq, const double *ddq, double *tau);
void calls(const double *q, const double *dq, const double *ddq, double *tau)
{{
    for (int k = 0; k < {count}; ++k) {{
        const int at = (k % {few}) * {n};
        {name}_inverse_dynamics_nominal(q + at, dq + at, ddq + at, tau + at);
    }}
}}
"""


@dataclass(frozen=True)
class BatchTime:
    """Nanoseconds per state of inverse dynamics with the file's numbers: in a batch, and by single calls in C."""

    batch: float
    single: float


def batch_time(case: Case, model: Model, toolchain: Toolchain, rounds: int) -> BatchTime:
    """Inverse dynamics of :data:`BATCH` states in ordinary NumPy arrays, on one core, in turns with single calls."""
    rng = np.random.default_rng(1)
    state = [rng.uniform(-scale, scale, (BATCH, case.n)) for scale in (np.pi, 3.0, 10.0)]
    pairs = zip(state, case.parts(), strict=False)
    small = [np.concatenate([part, values[: BATCH - len(part)]]) for values, part in pairs]
    wanted = case.references["file"].values["inverse_dynamics"]
    error = np.max(np.abs(model.inverse_dynamics(*small)[: len(wanted)] - wanted)) / np.max(np.abs(wanted))
    if not error < TOLERANCE:
        raise DisagreementError(f"{case.name}: the batch differs from the reference by {error:.1e}")
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        single = _single_calls(model, state, toolchain, Path(place))
        best = turns({"batch": lambda: model.inverse_dynamics(*state), "single": single}, 4 * rounds, SAMPLE)
    return BatchTime(1e9 * best["batch"] / BATCH, 1e9 * best["single"] / BATCH)


def _single_calls(model: Model, state: Sequence[Array], toolchain: Toolchain, place: Path) -> Callable[[], object]:
    """One call for each state of the batch."""
    derived, name = model.derived, model.derived.name
    files = header_and_sources(derived, identify(derived.spec), Dialect(name, "double"), sincos_strategy("inline"))
    files["calls.c"] = LOOP.format(name=name, n=derived.spec.n, count=BATCH, few=FEW)
    for file, text in files.items():
        (place / file).write_text(text, encoding="utf-8")
    sources = [str(place / file) for file in ("calls.c", f"{name}_nominal.c")]
    run([*toolchain.cc, *toolchain.flags, "-shared", "-fPIC", *sources, "-lm", "-o", str(place / "calls.so")])
    function = ctypes.CDLL(str(place / "calls.so")).calls
    arrays = [*state, np.empty((FEW, derived.spec.n))]
    pointers = [array.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for array in arrays]

    def calls(owned: object = arrays) -> None:  # the pointers own nothing
        function(*pointers)

    return calls
