"""The report in a browser at the widths of a phone, a laptop and a large screen. Skipped where Chromium is missing."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from itertools import combinations
from math import radians
from pathlib import Path

import numpy as np
import pytest

from pipeline.optimized import bundled
from rrrgen.derive import prepare
from rrrgen.derive.closed_forms.closed_form import closed_form
from rrrgen.program import evaluate
from rrrgen.report import html_report
from rrrgen.report.motions import Motion

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")

QUIET = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-component-update",
    "--disable-background-networking", "--disable-sync", "--enable-logging=stderr",
    "--force-prefers-reduced-motion",  # the arm jumps to a configuration: no frames are drawn
    "--virtual-time-budget=4000",
)  # fmt: skip

ANGLES = (0.4, -1.1, 0.9, -0.3, 0.7, 0.2)
PLAYED = np.array([0.2, -0.9, 0.5, 0.3, -0.6, 0.1])
PROBE = """
<script>
const found = { width: innerWidth, scroll: document.documentElement.scrollWidth, outside: [], tip: "" };
const scrolls = (e) => e !== document.body &&
  (/(auto|scroll)/.test(getComputedStyle(e).overflowX) || scrolls(e.parentElement));
document.querySelectorAll("body *").forEach((e) => {
  const box = e.getBoundingClientRect();
  if (box.width && box.right > innerWidth + 1 && !scrolls(e)) found.outside.push(e.tagName + "." + e.className);
});
const labels = [], fill = CanvasRenderingContext2D.prototype.fillText;
CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
  labels.push([text, x, y, x + this.measureText(text).width]);
  fill.call(this, text, x, y);
};
document.querySelectorAll("#joints input").forEach((input, i) => {
  labels.length = 0;
  input.value = ANGLES[i];
  input.dispatchEvent(new Event("input"));
});
found.labels = labels.slice();
found.tip = document.getElementById("tip").textContent;
const time = document.querySelector("#player input");
time.value = 2;
time.dispatchEvent(new Event("input"));
found.played = Array.from(document.querySelectorAll("#joints output")).map((e) => e.textContent);
const view = document.getElementById("view"), seen = new Set();
const pixels = view.getContext("2d").getImageData(0, 0, view.width, view.height).data;
for (let k = 0; k < pixels.length; k += 4) seen.add(pixels[k] + "," + pixels[k + 1] + "," + pixels[k + 2]);
found.colors = seen.size;
document.querySelectorAll("#configurations .choice button")[1].click();
found.branch = document.getElementById("branch").textContent;
found.chosen = Array.from(document.querySelectorAll("#joints output")).map((e) => e.textContent);
parent.postMessage(JSON.stringify(found), "*");
</script>
"""

# a window is at least 500 px wide; a frame in it may have the width of a phone
FRAME = """<pre id="found"></pre>
<script>addEventListener("message", (said) => { document.getElementById("found").textContent = said.data; });</script>
<iframe src="report.html" style="width:WIDTHpx;height:900px;border:0"></iframe>
"""


@pytest.fixture(scope="module")
def page() -> str:
    model = bundled("ur10e")
    forms = {name: closed_form(prepare(model.spec), name).readable() for name in ("forward_kinematics", "gravity")}
    motion = Motion("recording " + 60 * "x", np.array([0.0, 1.0, 3.0]), np.array([np.zeros(6), np.ones(6), PLAYED]))
    return html_report(model, forms, notice=f"Written from model {64 * 'a'}.", motions=[motion])


def opened(text: str, width: int, folder: Path) -> tuple[dict, str]:
    """What the probe found on the page of this width, and what the browser said on its console."""
    file = folder / "report.html"
    file.write_text(text.replace("</body>", PROBE.replace("ANGLES", json.dumps(ANGLES)) + "</body>"), encoding="utf-8")
    frame = folder / "frame.html"
    frame.write_text(FRAME.replace("WIDTH", str(width)), encoding="utf-8")
    command = [CHROMIUM, *QUIET, f"--user-data-dir={folder / 'profile'}", f"--window-size={width + 100},1000"]
    done = subprocess.run(
        [*command, "--dump-dom", frame.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    found = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.S)
    assert found is not None
    assert found[1], done.stderr[-2000:]
    console = "\n".join(line for line in done.stderr.splitlines() if "CONSOLE" in line)
    return json.loads(found[1].replace("&amp;", "&")), console


@pytest.fixture(scope="module")
def laptop(page: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, str]:
    return opened(page, 1280, tmp_path_factory.mktemp("laptop"))


@pytest.mark.parametrize("width", [390, 1280, 1920])
def test_report_is_whole_at_every_width(page: str, laptop: tuple[dict, str], width: int, tmp_path: Path) -> None:
    found, console = laptop if width == 1280 else opened(page, width, tmp_path)
    assert found["width"] == width
    assert console == ""
    assert found["scroll"] <= found["width"], "the page scrolls sideways"
    assert found["outside"] == [], "elements stand out of the page"
    assert found["colors"] > 20, "the canvas is empty"
    names = ", ".join(text for text, *_ in found["labels"]).split(", ")
    assert sorted(names) == [*"0123456", "tip"]
    for (_, x, y, end), (_, other, level, _) in combinations(sorted(found["labels"], key=lambda each: each[1]), 2):
        assert x <= other
        assert end < other or abs(y - level) > 11, "names of frames overlap"


def test_paper_needs_no_scrolling(page: str, tmp_path: Path) -> None:
    """What is printed, at the width of a page of paper: nothing stands out, and nothing scrolls."""
    found, console = opened(page.replace("@media print", "@media all"), 718, tmp_path)
    assert console == ""
    assert found["scroll"] <= 718
    assert found["outside"] == []


def test_a_click_shows_a_configuration_of_the_same_tip(page: str, laptop: tuple[dict, str]) -> None:
    view = json.loads(re.search(r'<script type="application/json" id="scene">(.*?)</script>', page, re.S)[1])
    chosen = view["poses"][0][1]
    found, console = laptop
    shown = [float(text.replace("−", "-").rstrip("°")) for text in found["chosen"]]
    assert console == ""
    np.testing.assert_allclose(shown, np.degrees(chosen["q"]), atol=0.051)
    assert re.fullmatch(r"\w+ \d(, \w+ \d)+", found["branch"])


def test_a_motion_is_interpolated_between_its_samples(laptop: tuple[dict, str]) -> None:
    found, console = laptop
    shown = [float(text.replace("−", "-").rstrip("°")) for text in found["played"]]
    assert console == ""
    np.testing.assert_allclose(shown, np.degrees((np.ones(6) + PLAYED) / 2), atol=0.051)


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
