"""What all passes have in common: roles instead of names, descriptions that survive, and determinism."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import pytest

from program.passes.programs import PORTS, STATE, recorded
from rrrgen.program import Builder, Port, Role, Status
from rrrgen.program.passes.common_factors import Collect
from rrrgen.program.passes.doubling import DoubleByAddition
from rrrgen.program.passes.folding import Fold
from rrrgen.program.passes.rewriting import CutSet, ExpandAndFactor


def test_passes_know_ports_by_their_roles():
    """Other names for the ports change nothing: neither where an expansion is cut nor what is folded in."""

    def function(b, q, dq, beta):
        shared = beta[0] * b.sin(q[0]) + beta[1] * b.cos(q[0])
        return [shared * dq[0] * dq[0], shared * dq[1] + beta[2]]

    program = recorded(function)
    renamed = program.with_fields(inputs=tuple(replace(port, name=f"x{k}") for k, port in enumerate(program.inputs)))
    for run in (*map(ExpandAndFactor, CutSet), Collect(), Fold({Role.BASE_PARAMETERS: STATE[2]})):
        one, other = run(program), run(renamed)
        assert (one.nodes, one.results) == (other.nodes, other.results)


def test_a_status_survives():
    b = Builder()
    (x, y), (k,) = b.input(PORTS[1]), b.input(Port("k", (), role=Role.BASE_PARAMETERS))
    status = Status.of(1, "too slow", "the speed is too low", "the first speed is not positive")
    outputs = [(Port("y", ()), [x * k + y * k + 2 * x]), (Port("status", ()), [b.select(x, 0, 1)])]
    program = b.program("f", outputs, status=status)
    for run in (ExpandAndFactor(CutSet.NOTHING), Collect(), DoubleByAddition(), Fold({Role.BASE_PARAMETERS: [3]})):
        changed = run(program)
        assert changed is not program
        assert changed.status == status
        assert [port.name for port in changed.data_outputs] == ["y"]


def test_labels_survive():
    program = recorded(lambda b, q, dq, beta: [b.label(b.sin(q[0] + q[1]), "s12") * dq[0] + 2 * dq[1]])
    for run in (ExpandAndFactor(CutSet.NOTHING), DoubleByAddition(), Fold({Role.BASE_PARAMETERS: STATE[2]})):
        assert "s12" in run(program).labels.values()


def test_passes_are_values_with_options():
    """Equal options make equal passes, so a pass can be shown, compared and kept in a table."""
    for one, other in ((Collect(), Collect()), (ExpandAndFactor(CutSet.SUMS), ExpandAndFactor(CutSet.SUMS, 100))):
        assert one == other
        assert repr(one) == repr(other)
    assert ExpandAndFactor(CutSet.SUMS) != ExpandAndFactor(CutSet.SUMS, max_terms=50)


# -- determinism -------------------------------------------------------------------------------------------------------

DIGEST = """
import hashlib
from rrrgen.derive import derive
from rrrgen.robot.file import load_spec
for name in ("scara",):
    derived = derive(load_spec(name))
    for program in derived.programs.values():
        text = repr((program, sorted(program.labels.items())))
        print(program.name, hashlib.sha256(text.encode()).hexdigest())
    print(derived.passes, derived.regrouping, derived.base_parameters)
"""


@pytest.mark.sweep  # tests/emit/test_determinism.py compares all files of two robots
def test_programs_do_not_depend_on_the_hash_seed():
    texts = set()
    for seed in ("0", "31337"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        run = subprocess.run(
            [sys.executable, "-c", DIGEST], env=environment, check=True, capture_output=True, text=True
        )
        texts.add(run.stdout)
    assert len(texts) == 1
    assert "inverse_dynamics_nominal" in texts.pop()
