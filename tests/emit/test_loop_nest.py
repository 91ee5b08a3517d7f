"""What all passes over loop nests have in common: every solution keeps its bits, whichever of them run."""

import shutil
import subprocess

import numpy as np
import pytest

from rrrgen.emit.c.ik.files import emit
from rrrgen.emit.c.ik.loop_nest import PASSES, Hoist, TakeArcsTogether
from rrrgen.ik.classify import plan
from rrrgen.robot.file import load_spec

POSES = 20
SUBSETS = ((), *((one,) for one in PASSES), PASSES)

MAIN = """
#include <stdio.h>
#include "{name}_ik.h"
int main(void)
{{
    double T[16];
    {name}_ik_solutions found;
    while (fread(T, sizeof(double), 16, stdin) == 16) {{
        (void){name}_inverse_kinematics(T, 0, 0u, &found);
        for (int i = 0; i < found.count; ++i) {{
            for (int j = 0; j < {n}; ++j) {{ printf("%a ", found.q[i][j]); }}
            printf("%u %u %a\\n", found.flags[i], found.branch[i], found.residual[i]);
        }}
    }}
    return 0;
}}
"""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
def test_solutions_keep_their_bits_and_no_pass_adds_an_operation(tmp_path):
    name = "puma560"
    spec = load_spec(name)
    found = plan(spec)
    rng = np.random.default_rng(4)
    targets = np.array([found.chain.forward(q) for q in rng.uniform(-2, 2, (POSES, found.chain.n))])
    targets[0] = found.chain.forward([0.0] * found.chain.n)  # free joints
    answers, counts = [], {}
    for k, passes in enumerate(SUBSETS):
        folder = tmp_path / str(k)
        folder.mkdir()
        emitted = emit(spec, found, passes=passes)
        for file, text in emitted.files.items():
            (folder / file).write_text(text)
        (folder / "main.c").write_text(MAIN.format(name=name, n=found.chain.n))
        sources = [folder / "main.c", folder / f"{name}_ik.c"]
        subprocess.run(["gcc", "-w", "-ffp-contract=off", "-o", folder / "main", *sources, "-lm"], check=True)
        run = subprocess.run([folder / "main"], input=targets.tobytes(), capture_output=True, check=True)
        answers.append(run.stdout)
        counts[passes] = emitted.operations
    assert len(answers[0].splitlines()) > POSES
    assert [k for k, answer in enumerate(answers) if answer != answers[0]] == []
    every, none = counts[PASSES], counts[()]
    for passes, counted in counts.items():
        more = [name for name, value in counted.as_dict().items() if value > none.as_dict()[name]]
        assert more == [], passes
    assert every.mul < 0.8 * none.mul
    assert every.atan2 < none.atan2


def test_passes_are_values_with_options():
    assert TakeArcsTogether() == TakeArcsTogether(4) != TakeArcsTogether(8)
    assert repr(TakeArcsTogether(8)) == "TakeArcsTogether(lanes=8)"
    assert Hoist() in PASSES
