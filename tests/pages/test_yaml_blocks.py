"""Every YAML block of the pages is read by the reader of its file; a part of a robot file stands in a robot file."""

from __future__ import annotations

import re

from pages.test_pages import PAGES, blocks
from rrrgen.lab.closed_loop.controller import loads_controller
from rrrgen.lab.data.mapping import loads_mapping
from rrrgen.lab.experiment.experiment_file import loads_experiment
from rrrgen.lab.response.response_file import loads_response
from rrrgen.robot.file import loads_spec as loads

HEAD = "schema: rrrgen/1\nname: arm\nconvention: standard\nunits: {angle: deg, length: mm}\ngravity: [0, 0, -9.81]\n"
TWO = "joints:\n" + "".join(f"  - {{name: q{k}, type: revolute, alpha: 0, a: 300, d: 0, theta: 0}}\n" for k in (1, 2))
LOG = """schema: rrrgen-log/1
files: flight.csv
time: {column: t, unit: s}
units: {position: rad, torque: N*m}
joints: [{name: q1, position: q_1, torque: tau_1}]
"""
READERS = {
    "schema: rrrgen/1": lambda text: loads(text).n,
    "schema: rrrgen-log/1": lambda text: len(loads_mapping(text).joints),
    "schema: rrrgen-controller/1": lambda text: len(loads_controller(text).joints),
    "schema: rrrgen-response/1": lambda text: len(loads_response(text).files),
    "schema: rrrgen-experiment/1": lambda text: loads_experiment(text, 3).period,
    "base:": lambda text: len(loads_mapping(LOG + text).joints) == 7,
    "response:": lambda text: loads_experiment(f"schema: rrrgen-experiment/1\n{text}", 3).response,
    "drives:": lambda text: loads(HEAD + TWO + text).drives,
    "friction:": lambda text: loads(HEAD + TWO.replace("theta: 0}", f"theta: 0, {text.strip()}}}")).joints[0].friction,
    "joints:": lambda text: loads(HEAD + text).mechanism,
    "ik:": lambda text: loads(HEAD + TWO + text).ik == "nominal_first",
}
"""How a block begins -> reads it; the result is something."""


def test_every_yaml_block_is_read() -> None:
    seen = set()
    for page in PAGES:
        for text in blocks(page.read_text(encoding="utf-8"), "yaml"):
            start = next(start for start in READERS if re.match(rf"{re.escape(start)}(?!\S)", text))
            assert READERS[start](text), f"{page.name}: {text}"
            seen.add(start)
    assert seen == set(READERS)
