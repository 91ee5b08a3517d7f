"""Time of one tick of the differential inverse kinematics on motions through singular configurations.

    python -m bench.measurements.differential_ik [ROBOT ...]

Every motion starts at a random posture with a random velocity of the tip, which turns round after half a second, within
2 rad/s and 15 rad/s^2. The least time of 25 rounds is taken for every problem: what a tick costs, not what else runs
on the machine.
"""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import click
import numpy as np

import rrrgen
from bench.toolchain import FLAGS
from rrrgen.emit.c.compilers import find_compiler
from rrrgen.emit.controller.differential_ik import declaration, differential_ik_files
from rrrgen.runtime.functions.differential import compiled_solver

ROBOTS = ("puma560", "iiwa14", "panda")
MOTIONS, TICKS, TAKEN = 6, 1000, 3  # motions of a robot, ticks of a motion, one of so many is timed
Ts = 1e-3

DRIVER = """
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <time.h>
#include "arm_differential_ik.h"
static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}
int main(int argc, char **argv)
{
    static double p[SIZE];
    FILE *file = fopen(argv[argc - 1], "rb");
    double dq[ARM_DIFFERENTIAL_IK_N];
    while (fread(p, sizeof(double), SIZE, file) == SIZE) {
        double least = 1e18;
        int round, k;
        for (round = 0; round < 25; round++) {
            const double start = now();
            for (k = 0; k < 4; k++) {
                (void)arm_differential_ik(ARGUMENTS, dq);
            }
            least = (now() - start) / 4.0 < least ? (now() - start) / 4.0 : least;
        }
        printf("%.1f\\n", least);
    }
    return 0;
}
"""


def problems(model: rrrgen.Model) -> np.ndarray:
    """The arguments of ticks along the motions, a row for each."""
    rng, n = np.random.default_rng(5), model.n
    solve, rows = compiled_solver("arm", n, "double"), []
    for _ in range(MOTIONS):
        q, dq, V = rng.uniform(-1.5, 1.5, n), np.zeros(n), rng.normal(size=6) * [0.5, 0.5, 0.5, 1, 1, 1]
        for k in range(TICKS):
            known: dict[str, np.ndarray | float] = {
                "weight": np.ones(6),
                "dq_ref": np.zeros(n),
                "damping": 0.02,
                "Ts": Ts,
            }
            known |= {"q": q, "dq_last": dq, "J": model.jacobian(q), "V": V if k < TICKS // 2 else -V}
            known |= {"q_min": np.full(n, -2.8), "q_max": np.full(n, 2.8)}
            known |= {"dq_max": np.full(n, 2.0), "ddq_max": np.full(n, 15.0)}
            values = [np.array(known[port.name], float) for port in declaration(n).inputs]
            rows.append(np.concatenate([np.ravel(value) for value in values]))
            dq = np.empty(n)
            solve(values, dq)
            q = q + Ts * dq
    return np.array(rows)[::TAKEN]


def measured(model: rrrgen.Model) -> np.ndarray:
    """The time of every problem, ns."""
    rows, n, at, arguments = problems(model), model.n, 0, []
    for port in declaration(n).inputs:
        arguments.append(f"p + {at}" if port.shape else f"p[{at}]")
        at += port.size
    driver = DRIVER.replace("SIZE", str(at)).replace("ARGUMENTS", ", ".join(arguments))
    with tempfile.TemporaryDirectory(prefix="differential-ik-") as name:
        folder = Path(name)
        for file, text in {**differential_ik_files("arm", n, "double"), "driver.c": driver}.items():
            (folder / file).write_text(text, encoding="utf-8")
        rows.tofile(folder / "problems")
        line = [
            *find_compiler().command,
            "-std=gnu99",
            *FLAGS,
            "driver.c",
            "arm_differential_ik.c",
            "-o",
            "driver",
            "-lm",
        ]
        subprocess.run(line, cwd=folder, check=True)
        done = subprocess.run([folder / "driver", "problems"], cwd=folder, capture_output=True, text=True, check=True)
    return np.array(done.stdout.split(), float)


@click.command()
@click.argument("robots", nargs=-1)
def main(robots: tuple[str, ...]) -> None:
    """Least, mean, 99 % quantile and slowest tick of ROBOTS, and how many of the problems take more than 830 ns.

    The least is a tick in which no joint meets a limit, which is damped least squares: a measure of the processor.
    """
    click.echo(f"{'ns per tick':12}{'least':>8}{'mean':>8}{'99 %':>8}{'slowest':>9}{'> 830':>7}")
    for name in robots or ROBOTS:
        ns = measured(rrrgen.compile(name))
        over = np.count_nonzero(ns > 830)
        click.echo(f"{name:12}{ns.min():8.0f}{ns.mean():8.0f}{np.quantile(ns, 0.99):8.0f}{ns.max():9.0f}{over:7}")


if __name__ == "__main__":
    main()
