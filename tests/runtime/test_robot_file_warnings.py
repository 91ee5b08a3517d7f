"""The warnings of a robot file in Python: one warning of a class of its own for each file, with every place in it."""

from __future__ import annotations

import subprocess
import sys
import warnings

import pytest

import rrrgen
from robot.file.sample import SAMPLE

DOUBTFUL = SAMPLE.replace("zz: 0.1}", "zz: 0.5}").replace("alpha: pi/2", "alpha: 1.5708")


def test_a_doubtful_file_warns_once(tmp_path):
    file = tmp_path / "elbow3.yaml"
    file.write_text(DOUBTFUL, encoding="utf-8")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = rrrgen.compile(file, backend="numpy")
        model.link_velocities([0.1, 0.2], [1.0, 2.0])  # another group, which is derived on first use
    ours = [each for each in caught if issubclass(each.category, rrrgen.RobotFileWarning)]
    assert len(ours) == 1
    assert ours[0].filename == __file__  # the line of the user, not one of ours
    text = str(ours[0].message)
    assert f"{file}:8:39: warning: alpha of joint 1 is 1.5708" in text
    assert "break the triangle" in text
    assert len(ours[0].message.faults) == 2


def test_who_reads_the_file_has_seen_its_warnings(tmp_path):
    spec = rrrgen.loads_spec(DOUBTFUL)
    assert len(spec.faults) == 2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rrrgen.compile(spec, backend="numpy")
        rrrgen.compile("planar2r", backend="numpy")


@pytest.mark.parametrize(("action", "code"), [("always", 0), ("error", 1)])
def test_the_switches_of_python_rule_it(tmp_path, action, code):
    """python -W finds classes of the standard library only: the base class of ours."""
    (tmp_path / "elbow3.yaml").write_text(DOUBTFUL, encoding="utf-8")
    call = "import rrrgen; rrrgen.compile('elbow3.yaml', backend='numpy')"
    command = [sys.executable, "-W", f"{action}::UserWarning", "-c", call]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == code, done.stderr
    assert "RobotFileWarning: elbow3.yaml:8:39: warning" in done.stderr
