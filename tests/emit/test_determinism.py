"""The same robot gives the same bytes in any process, and by any number of processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

SCRIPT = """
import hashlib, sys
from rrrgen.derive import derive
from rrrgen.emit.package import emit
from rrrgen.robot.file import load_spec
jobs = int(sys.argv[1])
for robot, real in (("rrr", "double"), ("planar2r", "float")):
    model = derive(load_spec(robot), jobs)
    assert robot != "rrr" or "numpy" not in sys.modules  # its threads would end the work of several processes
    files = emit(model, real, jobs=jobs)
    for name, text in sorted(files.items()):
        print(robot, name, hashlib.sha256(text.encode()).hexdigest())
"""


def test_every_file_is_the_same_under_every_hash_seed_and_number_of_processes(tmp_path):
    outputs = []
    for seed, jobs in (("0", "1"), ("12345", "3")):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT), "LC_ALL": "C", "TZ": f"X{seed}"}
        command = [sys.executable, "-c", SCRIPT, jobs]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True)
        outputs.append(done.stdout.splitlines())
    assert len(outputs[0]) >= 2 * 9
    assert outputs[0] == outputs[1]
