"""From measured poses to a solver for the controller: what ``calibrate`` writes is generated, compiled and called."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from lab.calibrate.mistakes_study import poses_as_columns, write
from lab.calibrate.virtual import measure, positions
from rrrgen.cli.main import cli
from rrrgen.lab.calibrate.geometry import geometry_of
from rrrgen.lab.calibrate.minimal_set import minimal_set
from rrrgen.robot.file import dumps, load_spec

COUNT = 40

PROGRAM = r"""
#include <math.h>
#include <stdio.h>
#include "puma560.h"
#include "puma560_ik.h"

static const double seeds[][6] = {SEEDS};

int main(void)
{
    int found = 0, k, i, j;
    for (k = 0; k < COUNT; k++) {
        puma560_ik_solutions s;
        double T[16], best = 10.0;
        puma560_forward_kinematics(seeds[k], T);
        puma560_inverse_kinematics(T, seeds[k], 0, &s);
        for (i = 0; i < s.count; i++) {
            double apart = 0.0;
            for (j = 0; j < 6; j++)
                apart = fmax(apart, fabs(s.q[i][j] - seeds[k][j]));
            best = fmin(best, apart);
        }
        found += best < 1e-6;
    }
    printf("%d of %d\n", found, COUNT);
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_calibrate_generate_compile_and_call_with_nominal_first(tmp_path):
    def run(*arguments):
        done = CliRunner().invoke(cli, list(map(str, arguments)), standalone_mode=False)
        assert done.exception is None, done.output
        return done.output

    spec, random = replace(load_spec("puma560"), links=None), np.random.default_rng(0)
    spec = replace(spec, joints=tuple(replace(joint, friction=None, drive=None) for joint in spec.joints))
    (tmp_path / "robot.yaml").write_text(dumps(spec))
    nominal = geometry_of(spec)
    entries = minimal_set(nominal, "pose").kept
    true = nominal.with_step(entries, random.normal(size=len(entries)) * 3e-4)
    q = positions(spec, 30, random)
    write(tmp_path / "poses.csv", poses_as_columns(q, measure("pose", true, q, random).values))
    run("calibrate", tmp_path / "robot.yaml", "--poses", tmp_path / "poses.csv", "-o", tmp_path / "calibrated.yaml")
    with (tmp_path / "calibrated.yaml").open("a") as file:
        file.write("ik: nominal_first\n")
    out = run("generate", tmp_path / "calibrated.yaml", "-o", tmp_path / "c", "--no-casadi-files")
    assert "nominal first: the at most 8 solutions of the nearest special arm" in out
    seeds = ", ".join("{" + ", ".join(map(repr, map(float, row))) + "}" for row in positions(spec, COUNT, random))
    (tmp_path / "c" / "main.c").write_text(PROGRAM.replace("SEEDS", seeds).replace("COUNT", str(COUNT)))
    sources = ["main.c", "puma560.c", "puma560_ik.c"]
    subprocess.run(["cc", "-std=c99", "-O0", *sources, "-lm", "-o", "main"], cwd=tmp_path / "c", check=True)
    done = subprocess.run([tmp_path / "c" / "main"], capture_output=True, text=True, check=True)
    assert done.stdout == f"{COUNT} of {COUNT}\n"
