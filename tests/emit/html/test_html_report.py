"""The HTML report: true numbers, well formed, self-contained, the same bytes every time."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oracles.newton_euler import Robot, frames
from pipeline.optimized import bundled
from rrrgen.base.errors import InputError
from rrrgen.cli.html import verification
from rrrgen.derive import prepare
from rrrgen.derive.closed_forms import closed_form
from rrrgen.emit.html import html_report
from rrrgen.emit.html.mathml import MathmlMarkup
from rrrgen.emit.html.scene import Illustration, PlayedMotion, scene
from rrrgen.emit.html.sketch import HEIGHT, WIDTH, frame_sketch, zero_pose
from rrrgen.emit.html.tables import dh_exact, dh_numbers, robot_file_tables
from rrrgen.emit.latex.equations import latex
from rrrgen.emit.latex.formulas import Walk
from rrrgen.ik.geometry.chain import numeric_chain
from rrrgen.robot.file import bundled_names, bundled_path, load_spec, loads_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of
from rrrgen.verify.report import Report, Row

GEOMETRY = 1e-12  # the same products of transforms, metres

VOID = {"meta", "link", "br", "hr", "img", "input"}


class Reader(HTMLParser):
    """Collects the text of every table row, checks that tags are balanced, and notes every attribute."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.attributes: set[str] = set()
        self.tags: set[str] = set()
        self.rows: list[list[str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}
        if tag not in VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th") and self.rows:
            self.rows[-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        self.attributes |= {name for name, _ in attrs}

    def handle_endtag(self, tag: str) -> None:
        assert self.open, tag
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.rows and self.rows[-1] and {"td", "th"} & set(self.open):
            self.rows[-1][-1] += data


def read(text: str) -> Reader:
    reader = Reader()
    reader.feed(text)
    reader.close()
    assert not reader.open
    return reader


@cache
def forms(name: str) -> dict[str, Any]:
    recorded = prepare(bundled(name).spec)
    return {f: closed_form(recorded, f).matrix() for f in ("forward_kinematics", "mass_matrix", "gravity")}


@pytest.mark.parametrize("name", ["rrr", "panda", "gantry", "pendulum"])
def test_report_is_well_formed_and_fetches_nothing(name: str) -> None:
    text = html_report(bundled(name), forms(name) if name == "rrr" else {})
    reader = read(text)
    assert not reader.tags & {"link", "img", "iframe", "object", "embed"}
    assert text.count("<script") == 4  # the scene and the view, both inline
    assert not reader.attributes & {"src", "href", "style", "onload"}
    assert "url(" not in text
    assert "http" not in re.sub(re.escape(bundled(name).spec.source), "", text)
    assert "nan" not in re.findall(r"[\w.]+", text)


def test_tables_hold_the_numbers_of_the_robot() -> None:
    derived = bundled("rrr")
    rows = read(html_report(derived, {})).rows
    assert ["2", "0", "0.2", "0.169", "q2"] in rows  # rad, m
    assert ["2", "0", "200", "169", "q2"] in rows  # degrees, mm
    assert ["1", "1.5708", "0", "0.56", "q1"] in rows
    assert ["1", "90", "0", "560", "q1"] in rows
    names = [row[1] for row in rows if len(row) in (4, 5) and re.fullmatch(r"p\d+", row[1].replace(" ", ""))]
    assert names == [f"p{k}" for k in range(1, 16)]
    functions = {row[0] for row in rows if len(row) == 8}
    assert set(derived.programs) <= functions
    assert {item.parameter for item in derived.regrouping} <= {row[0] for row in rows if len(row) == 3}


def test_convention_is_stated() -> None:
    assert "Standard (distal)" in html_report(bundled("rrr"), {})
    assert "Modified (proximal)" in html_report(bundled("panda"), {})


def test_closed_forms_appear_as_mathml() -> None:
    text = html_report(bundled("rrr"), forms("rrr"))
    assert text.count('<table class="equations">') == 4  # three functions and the inverse kinematics
    assert "mass_matrix: mass matrix" in text
    assert "<msub><mi>c</mi><mrow><mn>23</mn></mrow></msub>" in text


def test_verification_table_shows_failures() -> None:
    good = Row("inverse_dynamics", "Newton-Euler", "random", 100, 3.2e-15, 1e-11)
    bad = Row("gravity", "Newton-Euler", "random", 100, 0.5, 1e-11, "sign")
    passed = html_report(
        bundled("rrr"), {}, verification(Report("rrr", 100, 7, (good,), (("MuJoCo", "not installed"),)))
    )
    assert "All comparisons pass" in passed
    assert 'class="failed"' not in passed
    assert "MuJoCo" in passed
    failed = html_report(bundled("rrr"), {}, verification(Report("rrr", 100, 7, (good, bad))))
    assert "Some comparisons FAIL" in failed
    assert failed.count('class="failed"') == 1
    assert ["gravity", "Newton-Euler", "random", "100", "5.0e-01", "1e-11", "FAIL: sign"] in read(failed).rows


def test_text_of_the_file_is_escaped() -> None:
    spec = replace(bundled("rrr").spec, description="<script>alert(1)</script> & more")
    text = html_report(replace(bundled("rrr"), spec=spec), {}, notice="<b>")
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; more" in text
    assert "&lt;b&gt;" in text


def test_hostile_names_stay_text() -> None:
    """Every text that a person writes: names of robot, joints and parameters, source, motion, figure, notice."""
    hostile = '"><img src=x onerror=alert(1)></script><script>alert(2)</script>'
    spec = bundled("rrr").spec
    named = replace(
        spec,
        name=hostile,
        description=hostile,
        source=hostile,
        joints=(replace(spec.joints[0], name=hostile), *spec.joints[1:]),
    )
    motion = PlayedMotion(hostile, np.array([0.0, 1.0]), np.zeros((2, 3)))
    figure = Illustration(hostile, "data:image/png;base64,AA==")
    plain = read(
        html_report(bundled("rrr"), {}, motions=[replace(motion, name="m")], figures=[replace(figure, caption="f")])
    )
    text = html_report(replace(bundled("rrr"), spec=named), {}, notice=hostile, motions=[motion], figures=[figure])
    reader = read(text)
    assert reader.tags == plain.tags
    assert reader.attributes == plain.attributes
    assert text.count("<script") == 4
    with pytest.raises(InputError):  # and a robot file with such a name is refused
        loads_spec(bundled_path("rrr").read_text(encoding="utf-8").replace("name: rrr", f"name: '{hostile}'", 1))


def test_the_whole_file_is_stated_in_both_units() -> None:
    rows = read(html_report(bundled("panda"), {})).rows
    assert [
        "translation",
        "x\u00a00\u00a0m\u00a0(0\u00a0mm)",
        "y\u00a00\u00a0m\u00a0(0\u00a0mm)",
        "z\u00a00.107\u00a0m\u00a0(107\u00a0mm)",
    ] in rows
    limits = next(row for row in rows if row[0] == "panda_joint4" and "rad/s" in "".join(row))
    assert "2.175\u00a0rad/s\u00a0(124.618\u00a0deg/s)" in limits
    assert "12.5\u00a0rad/s²\u00a0(716.197\u00a0deg/s²)" in limits
    assert any(row[0] == "4" and row[1] == "2.7\u00a0kg" and "com" in row for row in rows)
    assert "does not state: base, friction, drives" in html_report(bundled("panda"), {})


def test_names_of_joints_cannot_end_the_script_that_holds_the_scene() -> None:
    spec = bundled("rrr").spec
    name = "</script><script>alert(1)</script>"
    hostile = replace(spec, joints=(replace(spec.joints[0], name=name), *spec.joints[1:]))
    text = html_report(replace(bundled("rrr"), spec=hostile), {})
    assert text.count("<script") == 4
    held = re.search(r'<script type="application/json" id="scene">(.*?)</script>', text, re.S)
    assert held is not None
    assert json.loads(held[1])["joints"][0]["name"] == name


@pytest.mark.parametrize("name", bundled_names())
def test_first_pose_is_bent_and_within_the_limits(name: str) -> None:
    spec = load_spec(name)
    q = scene(spec)["start"]
    for value, joint in zip(q, spec.joints, strict=True):
        lower, upper = joint.limits.lower, joint.limits.upper
        assert lower is None or value >= lower
        assert upper is None or value <= upper
    if spec.n in (3, 6) and name != "gantry":  # the tip moves freely in every direction that it has
        chain = numeric_chain(spec)
        J = chain.jacobian(q)[: 3 if spec.n == 3 else 6]
        J[:3] /= chain.reach
        assert np.linalg.svd(J, compute_uv=False)[-1] > 0.05


def test_zero_pose_shows_no_round_off_and_units_have_raised_exponents() -> None:
    text = html_report(bundled("ur10e"), {})
    assert "e−17" not in text
    assert "kg\xa0m²" in text
    assert "kg m^2" not in text


@pytest.mark.parametrize("name", bundled_names())
def test_zero_pose_is_that_of_the_oracle(name: str) -> None:
    spec = load_spec(name)
    base, stages, tip = zero_pose(spec)
    nominal = dict(spec.parameters)
    tool = np.array(spec.tool.matrix().subs(nominal), float)
    robot = Robot(
        spec.convention, tuple(spec.dh_table()), base=np.array(spec.base.matrix().subs(nominal), float), tool=tool
    )
    expected = frames(robot, np.zeros(spec.n))
    np.testing.assert_allclose(np.array(base), robot.base, atol=GEOMETRY)
    np.testing.assert_allclose(np.array(tip), expected.tip, atol=GEOMETRY)
    for i, stage in enumerate(stages):
        np.testing.assert_allclose(np.array(stage.frame), expected.links[i], atol=GEOMETRY)
        np.testing.assert_allclose(np.array(stage.path[-1]), expected.links[i][:3, 3], atol=GEOMETRY)
        point, direction = (np.array(v) for v in stage.axis)
        np.testing.assert_allclose(direction, expected.axes[i], atol=GEOMETRY)
        np.testing.assert_allclose(np.cross(direction, point - expected.points[i]), 0.0, atol=GEOMETRY)


@pytest.mark.parametrize("name", bundled_names())
def test_sketch_stays_on_its_sheet(name: str) -> None:
    text = frame_sketch(load_spec(name))
    xs = [float(v) for v in re.findall(r'\b(?:x|x1|x2|cx)="(-?[\d.]+)"', text)]
    ys = [float(v) for v in re.findall(r'\b(?:y|y1|y2|cy)="(-?[\d.]+)"', text)]
    assert min(xs) >= 0
    assert max(xs) <= WIDTH
    assert min(ys) >= 0
    assert max(ys) <= HEIGHT
    assert "-0.0" not in text
    assert text.count('class="joint"') == load_spec(name).n


def test_a_mechanism_is_shown_with_its_branches_and_couplings() -> None:
    spec = load_spec(Path(__file__).resolve().parents[3] / "examples" / "palletiser" / "robot.yaml")
    data = scene(spec)
    assert [row["parent"] for row in data["rows"]] == [-1, 0, 0, 2, 1, 4, 5]
    assert data["rows"][3]["factors"] == [0, 1, -1, 0]
    assert (data["tip_row"], len(data["joints"])) == (6, 4)
    assert data["followers"] == [
        {"name": "forearm", "along": (0, -1, 1, 0), "lower": radians(-75), "upper": radians(65)}
    ]
    _, stages, tip = zero_pose(spec)
    chain = chain_of(spec)
    frames = NewtonEuler(chain, np.zeros((chain.links, 10))).link_frames(np.zeros((1, 4)))[0]
    np.testing.assert_allclose([stage.frame for stage in stages], frames, atol=GEOMETRY)
    np.testing.assert_allclose(tip, frames[6] @ chain.tool, atol=GEOMETRY)
    assert np.linalg.norm(np.subtract(stages[3].frame, stages[4].frame)[:3, 3]) > 0.5  # two ends of two branches
    walk = Walk(MathmlMarkup(), False)
    table = dh_exact(spec, walk)
    assert table.headings[3] == "on"
    assert [row[3] for row in table.rows] == ["base", "column", "column", "elbow", "shoulder", "forearm", "wrist"]
    assert [row[4] for row in dh_numbers(spec, in_degrees=True).rows][3:5] == ["q2 − q3 − 90", "−q2 + q3 + 90"]
    assert [row[0] for row in dict(robot_file_tables(spec))["Limits of the joints"].rows] == [
        "column",
        "shoulder",
        "elbow",
        "turn",
        "forearm",
    ]
    assert "q2 − q3" in frame_sketch(spec)


_HASH = """
import hashlib
from rrrgen.emit.latex.equations import latex
from rrrgen.derive.closed_forms import closed_form
from rrrgen.derive import derive, prepare
from rrrgen.emit.html import html_report
from rrrgen.robot.file import load_spec
m = derive(load_spec("rrr"))
forms = {f: closed_form(prepare(m.spec), f).matrix() for f in ("mass_matrix", "coriolis")}
print(hashlib.sha256((html_report(m, forms) + latex(forms, cse_limit=20)).encode()).hexdigest())
"""


def test_report_repeats_in_a_fresh_process() -> None:
    seed = "0" if os.environ.get("PYTHONHASHSEED") == "77" else "77"  # another one than here
    environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": str(Path(__file__).resolve().parents[3])}
    done = subprocess.run(
        [sys.executable, "-c", _HASH], env=environment, check=True, capture_output=True, text=True, timeout=120
    )
    m = bundled("rrr")
    chosen = {f: closed_form(prepare(m.spec), f).matrix() for f in ("mass_matrix", "coriolis")}
    here = html_report(m, chosen) + latex(chosen, cse_limit=20)
    assert done.stdout.strip() == hashlib.sha256(here.encode()).hexdigest()
