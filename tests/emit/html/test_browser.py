"""The report in a browser at the widths of a phone, a laptop and a large screen. Skipped where Chromium is missing."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from itertools import combinations
from math import radians
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest

from pipeline.optimized import bundled
from rrrgen.base.templates import template_text
from rrrgen.derive import prepare
from rrrgen.derive.closed_forms import closed_form
from rrrgen.emit.html import html_report
from rrrgen.emit.html.document import script_text
from rrrgen.emit.html.scene import Illustration, PlayedMotion, as_json, scene
from rrrgen.emit.targets.javascript_ik import modules
from rrrgen.ik.geometry.chain import numeric_chain
from rrrgen.program import evaluate
from rrrgen.robot.file import load_spec
from rrrgen.robot.identity import identify
from rrrgen.robot.spec import RobotSpec

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-component-update",
    "--disable-background-networking", "--disable-sync", "--enable-logging=stderr",
    "--force-prefers-reduced-motion",  # the arm jumps to a configuration: no frames are drawn
    "--virtual-time-budget=4000",
)  # fmt: skip

ANGLES = (0.4, -1.1, 0.9, -0.3, 0.7, 0.2)
DRAWN = 800  # width of a plot, px
PLAYED = np.array([0.2, -0.9, 0.5, 0.3, -0.6, 0.1])
PROBE = r"""
<script type="module">
const found = { width: innerWidth, scroll: document.documentElement.scrollWidth, outside: [], tip: "" };
const scrolls = (e) => e !== document.body &&
  (/(auto|scroll)/.test(getComputedStyle(e).overflowX) || scrolls(e.parentElement));
document.querySelectorAll("body *").forEach((e) => {
  const box = e.getBoundingClientRect();
  if (box.width && box.right > innerWidth + 1 && !scrolls(e)) found.outside.push(e.tagName + "." + e.className);
});
const tone = (text) => {
  const [r, g, b, a] = text.match(/[\d.]+/g).map(Number);
  const part = (v) => (v / 255 <= 0.03928 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
  return { light: 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b), clear: a === 0 };
};
const ground = (e) => {
  const found = tone(getComputedStyle(e).backgroundColor);
  return found.clear ? ground(e.parentElement) : found.light;
};
found.pale = [];  // text with too little contrast to its ground
document.querySelectorAll("body *").forEach((e) => {
  if (!e.getClientRects().length || ![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) return;
  if (e.classList.contains("halo")) return;
  const style = getComputedStyle(e), svg = e instanceof SVGElement;
  const [dark, light] = [tone(svg ? style.fill : style.color).light, ground(e)].sort((a, b) => a - b);
  if ((light + 0.05) / (dark + 0.05) < 4.5) found.pale.push(e.tagName + " " + e.textContent.slice(0, 30));
});
found.dark = matchMedia("(prefers-color-scheme: dark)").matches;
found.plot = document.querySelector(".plot img").offsetWidth;
const labels = [], fill = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
  labels.push([text, x, y, x + this.measureText(text).width]);
  fill.call(this, text, x, y);
};
const view = document.getElementById("view"), seen = new Set();
const shown = () => Array.from(document.querySelectorAll("#joints output")).map((e) => e.textContent);
const set = (input, value) => { input.value = value; input.dispatchEvent(new Event("input")); };
const sliders = document.querySelectorAll("#joints input");
found.ends = [];
["min", "max"].forEach((end) => sliders.forEach((input) => {
  labels.length = 0;
  set(input, input[end]);
  found.ends.push([end, input.value, ...labels.map((l) =>
    l[1] > 0 && l[1] < view.clientWidth && l[2] > 0 && l[2] < view.clientHeight)]);
}));
sliders.forEach((input, i) => {
  labels.length = 0;
  set(input, ANGLES[i]);
});
found.labels = labels.slice();
found.tip = document.getElementById("tip").textContent;
found.played = Array.from(document.querySelectorAll("#player input")).map((time) => { set(time, 2); return shown(); });
const pixels = view.getContext("2d").getImageData(0, 0, view.width, view.height).data;
for (let k = 0; k < pixels.length; k += 4) seen.add(pixels[k] + "," + pixels[k + 1] + "," + pixels[k + 2]);
found.colors = seen.size;
document.querySelectorAll("#configurations .choice button")[1].click();
found.branch = document.getElementById("branch").textContent;
found.chosen = shown();
labels.length = 0;
[...document.querySelectorAll("#actions button")].find((button) => button.textContent === "Frames").click();
found.unframed = labels.map((label) => label[0]);
parent.postMessage(JSON.stringify(found), "*");
</script>
"""

# a window is at least 500 px wide; a frame in it may have the width of a phone
FRAMES = """<pre id="found"></pre>
<script>
const found = [];
addEventListener("message", (said) => {
  const frames = Array.from(document.querySelectorAll("iframe"), (frame) => frame.contentWindow);
  found[frames.indexOf(said.source)] = said.data;
  document.getElementById("found").textContent = JSON.stringify(found);
});
</script>
"""
FRAME = '<iframe src="FILE" style="display:block;border:0;width:WIDTHpx;height:900px"></iframe>\n'


@pytest.fixture(scope="module")
def page() -> str:
    model = bundled("ur10e")
    forms = {name: closed_form(prepare(model.spec), name).readable() for name in ("forward_kinematics", "gravity")}
    recording = PlayedMotion(
        "recording " + 60 * "x", np.array([0.0, 1.0, 3.0]), np.array([np.zeros(6), np.ones(6), PLAYED])
    )
    trajectory = PlayedMotion("trajectory", np.array([0.0, 2.0]), np.array([np.zeros(6), PLAYED]))
    drawing = f"<svg xmlns='http://www.w3.org/2000/svg' width='{DRAWN}' height='90'/>"
    figure = Illustration("a plot", f"data:image/svg+xml,{quote(drawing)}", DRAWN)
    motions = [recording, trajectory]
    return html_report(model, forms, notice=f"Written from model {64 * 'a'}.", motions=motions, figures=[figure])


def opened(pages: list[tuple[str, int]], folder: Path, *options: str, probe: str = PROBE) -> tuple[list[dict], str]:
    """What the probe found on pages, each opened in a frame of a width, and what the browser said on its console."""
    probe, frames = probe.replace("ANGLES", json.dumps(ANGLES)), FRAMES
    for k, (text, width) in enumerate(pages):
        (folder / f"report{k}.html").write_text(text.replace("</body>", probe + "</body>"), encoding="utf-8")
        frames += FRAME.replace("FILE", f"report{k}.html").replace("WIDTH", str(width))
    frame = folder / "frames.html"
    frame.write_text(frames, encoding="utf-8")
    size = f"--window-size={max(width for _, width in pages) + 100},{900 * len(pages) + 200}"  # all in sight
    done = subprocess.run(
        [CHROMIUM, *QUIET, *options, f"--user-data-dir={folder / 'profile'}", size, "--dump-dom", frame.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.S)
    assert found is not None
    assert found[1], done.stderr[-2000:]
    console = "\n".join(line for line in done.stderr.splitlines() if "CONSOLE" in line)
    return [json.loads(each) for each in json.loads(unescape(found[1]))], console


@pytest.fixture(scope="module")
def screens(page: str, tmp_path_factory: pytest.TempPathFactory) -> dict[str | int, tuple[dict, str]]:
    """What is found at the widths of a phone and a laptop, and on "paper", in one browser: it takes long to start."""
    paper = page.replace("@media print", "@media all")
    found, console = opened([(page, 390), (page, 1280), (paper, 718)], tmp_path_factory.mktemp("screens"))
    return {name: (each, console) for name, each in zip((390, 1280, "paper"), found, strict=True)}


@pytest.fixture(scope="module")
def laptop(screens: dict[str | int, tuple[dict, str]]) -> tuple[dict, str]:
    return screens[1280]


@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_report_is_whole_at_every_width(
    page: str, screens: dict[str | int, tuple[dict, str]], width: int, tmp_path: Path
) -> None:
    dark = width not in screens
    if dark:
        (found,), console = opened([(page, width)], tmp_path, "--force-dark-mode")
    else:
        found, console = screens[width]
    assert found["width"] == width
    assert found["dark"] == dark
    assert found["pale"] == [], "text has too little contrast"
    assert found["plot"] == DRAWN, "the text of plots is smaller than they were drawn"
    assert console == ""
    assert found["scroll"] <= found["width"], "the page scrolls sideways"
    assert found["outside"] == [], "elements stand out of the page"
    assert found["colors"] > 20, "the canvas is empty"
    names = ", ".join(text for text, *_ in found["labels"]).split(", ")
    assert sorted(names) == [*"0123456", "tip"]
    for (_, x, y, end), (_, other, level, _) in combinations(sorted(found["labels"], key=lambda each: each[1]), 2):
        assert x <= other
        assert end < other or abs(y - level) > 11, "names of frames overlap"


def test_sliders_reach_the_limits_with_the_arm_in_view(laptop: tuple[dict, str]) -> None:
    found, _ = laptop
    limits = [(joint.limits.lower, joint.limits.upper) for joint in bundled("ur10e").spec.joints]
    reached = [float(value) for _, value, *_ in found["ends"]]
    np.testing.assert_allclose(np.reshape(reached, (2, 6)).T, np.array(limits, float), atol=1e-8)
    assert all(len(inside) > 0 and all(inside) for _, _, *inside in found["ends"])


def test_frames_are_hidden_by_a_click(laptop: tuple[dict, str]) -> None:
    found, _ = laptop
    assert found["unframed"] == ["tip"]


def test_paper_needs_no_scrolling(screens: dict[str | int, tuple[dict, str]]) -> None:
    """What is printed, at the width of a page of paper: nothing stands out, and nothing scrolls."""
    found, console = screens["paper"]
    assert console == ""
    assert found["scroll"] <= 718, found["outside"]
    assert found["outside"] == []


def test_a_click_shows_a_configuration_of_the_same_tip(page: str, laptop: tuple[dict, str]) -> None:
    view = json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', page, re.S)[1])
    found, console = laptop
    shown = np.radians([float(text.replace("−", "-").rstrip("°")) for text in found["chosen"]])
    assert console == ""
    chain = numeric_chain(bundled("ur10e").spec)
    assert np.abs(shown - view["start"]).max() > 0.1
    np.testing.assert_allclose(chain.forward(shown), chain.forward(view["start"]), atol=5e-3)
    assert re.fullmatch(r"\w+ [+−](, \w+ [+−])+", found["branch"])


def test_motions_are_interpolated_between_their_samples(laptop: tuple[dict, str]) -> None:
    found, console = laptop
    assert console == ""
    recorded, designed = ([float(text.replace("−", "-").rstrip("°")) for text in each] for each in found["played"])
    np.testing.assert_allclose(recorded, np.degrees((np.ones(6) + PLAYED) / 2), atol=0.051)
    np.testing.assert_allclose(designed, np.degrees(PLAYED), atol=0.051)


def test_view_computes_the_pose_of_the_tip(laptop: tuple[dict, str]) -> None:
    found, _ = laptop
    numbers = [float(text.replace("−", "-")) for text in re.findall(r"−?\d+\.\d+", found["tip"])]
    model = bundled("ur10e")
    T = np.asarray(evaluate(model.programs["forward_kinematics"], np.array(ANGLES))[0], float)
    np.testing.assert_allclose(numbers[:3], 1000 * T[:3, 3], atol=0.051)
    roll, pitch, yaw = (radians(value) for value in numbers[3:])
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    R = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    np.testing.assert_allclose(R, T[:3, :3], atol=2e-4)


TIPS = r"""
<script type="module">
const found = [], $ = (query) => document.querySelector(query);
const wait = () => new Promise((resolve) => setTimeout(resolve, 60));
const buttons = () => [...document.querySelectorAll("#configurations button")];
const tips = $("#place select") ? [...$("#place select").options].map((option) => option.value) : [null];
for (const tip of tips) {
  if (tip !== null) { $("#place select").value = tip; $("#place select").dispatchEvent(new Event("change")); }
  await wait();
  const before = $("#tip").textContent;
  const place = document.querySelectorAll("#place input")[1];  // y, in which all these tips can move
  place.value = Number(place.value) - 5;
  place.dispatchEvent(new Event("change"));
  await wait();
  const name = tip === null ? "" : $("#place select").selectedOptions[0].text, said = $("#branch").textContent;
  const each = { name, before, tips: [], joints: [], said };
  for (let k = 0; k < buttons().length; k++) {
    buttons()[k].click();
    await wait();
    each.tips.push($("#tip").textContent);
    each.joints.push([...document.querySelectorAll("#joints output")].map((e) => e.textContent).join(" "));
  }
  found.push(each);
}
parent.postMessage(JSON.stringify(found), "*");
</script>
"""


CALLS = "tip_pose, inverse_kinematics, approach"
VIEW = """<!DOCTYPE html><body><div id="viewer"><canvas id="view" style="width:600px;height:400px"></canvas>
<p id="tip"></p><div id="player"></div><div id="joints"></div><p id="actions"></p><p id="place"></p>
<div id="configurations"></div><p id="branch"></p></div><script>const solvers = {};</script>
MODULES<script type="module">VIEWER
armViewer().load(SCENE, solvers);</script></body>"""


def view_of(spec: RobotSpec) -> str:
    """A page with the view of the report alone, which does not wait for the dynamics of a tree."""
    inverse = [
        f"<script type='module'>{script_text(text)}\nsolvers['{tip}'] = {{ {CALLS} }};</script>"
        for tip, text in modules(spec, identify(spec)).items()
    ]
    page = VIEW.replace("VIEWER", template_text("report/viewer.js")).replace("SCENE", as_json(scene(spec)))
    return page.replace("MODULES", "\n".join(inverse))


def test_every_tip_of_trees_and_mechanisms_is_moved_among_its_configurations(tmp_path: Path) -> None:
    """A palletiser with a parallelogram; the two arms of a torso, each on shared joints, and the fingers of a hand."""
    examples = Path(__file__).resolve().parents[3] / "examples"
    names = ("palletiser/robot", "trees/torso", "trees/hand")
    pages = [(view_of(load_spec(examples / f"{name}.yaml")), 1000) for name in names]
    answers, console = opened(pages, tmp_path, probe=TIPS)
    assert console == ""
    assert [[each["name"] for each in tips] for tips in answers] == [[""], ["left", "right"], ["finger", "thumb"]]
    for each in (each for tips in answers for each in tips):
        count = len(each["joints"])
        assert count > 1, each["said"]
        assert len(set(each["joints"])) == count
        assert len(set(each["tips"])) == 1
        before, after = (
            float(re.findall(r"−?[\d.]+", text)[1].replace("−", "-")) for text in (each["before"], each["tips"][0])
        )
        assert after == pytest.approx(before - 5.0, abs=0.11)
