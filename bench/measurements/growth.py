"""How cost grows with the number of joints: random chains, the same contenders."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from bench.contenders.cases import Case, make_case
from bench.contenders.contender import Supplier
from bench.contenders.emitted import emitted_contenders
from bench.measurements.race import Effort, Score, race
from bench.toolchain import Toolchain
from rrrgen.robot.spec import RobotSpec

Rivals = Callable[[Case], list[Supplier]]

COMPARED = ("mass_matrix", "bias", "inverse_dynamics")
RIGHT_ANGLES = ("0", "pi/2", "-pi/2")


def chain_text(n: int, seed: int = 0) -> str:
    """A robot file with ``n`` revolute joints: neighbouring axes parallel or at right angles, random offsets."""
    rng = np.random.default_rng([seed, n])
    rows = []
    for j in range(n):
        alpha = RIGHT_ANGLES[int(rng.choice(3, p=(0.3, 0.35, 0.35)))]
        a, d = (round(float(rng.uniform(0.05, 0.5)), 3) if rng.random() < 0.6 else 0 for _ in range(2))
        rows.append(f"  - {{name: j{j + 1}, type: revolute, alpha: {alpha}, a: {a}, d: {d}, theta: 0}}")
    head = f"schema: rrrgen/1\nname: chain{n}\nconvention: standard\nunits: {{angle: rad, length: m}}\n"
    return head + "gravity: [0, 0, -9.81]\njoints:\n" + "\n".join(rows) + "\n"


def growth(
    sizes: list[int], toolchain: Toolchain, effort: Effort, seconds: float, rivals: Rivals, say: Callable[[str], None]
) -> tuple[list[Score], list[float]]:
    """Scores of :data:`COMPARED` for every size, and seconds of derivation; stops once ``seconds`` are used up."""
    from rrrgen.robot.file import loads_spec

    scores: list[Score] = []
    derivations: list[float] = []
    start = time.perf_counter()
    for n in sizes:
        if time.perf_counter() - start > seconds:
            break
        say(f"chain of {n} joints")
        found, duration = _one(loads_spec(chain_text(n), f"chain{n}.yaml"), toolchain, effort, rivals)
        scores += found
        derivations.append(duration)
    return scores, derivations


def _one(spec: RobotSpec, toolchain: Toolchain, effort: Effort, rivals: Rivals) -> tuple[list[Score], float]:
    from rrrgen.derive import derive_model
    from rrrgen.derive.optimizer import Optimizer

    start = time.perf_counter()
    recorded = derive_model(spec)
    derived = Optimizer()(recorded.only({name: recorded.alternatives[name] for name in COMPARED}))
    duration = time.perf_counter() - start
    case = make_case(spec)
    groups = [emitted_contenders(case, derived, libm=False), *rivals(case)]
    for group in groups:
        group.contenders = [each for each in group.contenders if each.function in COMPARED]
    return race(case, groups, toolchain, effort), duration
