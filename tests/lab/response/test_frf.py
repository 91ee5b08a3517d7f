"""The command frf: the response and its figure, postures side by side."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from lab.response.periodic import SAMPLES, write
from rrrgen.cli.main import cli, run
from rrrgen.lab.response.frequency_response import read_responses
from samples.flexible_joint import PERIOD


def test_command_writes_the_response_and_its_figure(periodic, tmp_path):
    log = write(tmp_path, periodic)
    told = CliRunner().invoke(cli, ["response", "frf", str(log), "-o", str(tmp_path / "run")], standalone_mode=False)
    assert told.return_value == 0, told.output
    assert "trusted" in told.output
    found = json.loads((tmp_path / "run/results/frf.json").read_text())
    lengths = {len(found[key]) for key in ("frequency", "re", "im", "band95", "coherence", "trusted")}
    assert lengths == {400}
    assert found["method"].startswith("local_polynomial")
    assert np.allclose(np.array(found["frequency"]), 0.5 + 0.5 * np.arange(400))
    assert (tmp_path / "run/figures/frf.png").is_file()
    (again,) = read_responses(tmp_path / "run/results/frf.json")
    assert np.allclose(again.P, np.array(found["re"]) + 1j * np.array(found["im"]))
    assert np.allclose(again.unsmoothed.variance, found["unsmoothed"]["variance"])


@pytest.mark.usefixtures("no_figures")
def test_postures_stand_beside_one_another(periodic, noisy, tmp_path):
    for name, each in (("left", periodic), ("right", noisy)):
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([PERIOD * np.arange(SAMPLES), each.n, each.u, each.q]))
    text = (
        "schema: rrrgen-response/1\nfiles: [left.csv, right.csv]\ntime: {column: 1}\nexcitation: {column: 2}\n"
        "input: 3\noutput: 4\nrecordings: postures\n"
    )
    (tmp_path / "response.yaml").write_text(text)
    assert run(["response", "frf", str(tmp_path / "response.yaml"), "-o", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run/results/frf.json").read_text())
    assert [each["name"] for each in found["postures"]] == ["left", "right"]
