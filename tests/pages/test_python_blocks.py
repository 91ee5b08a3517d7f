"""The Python on the pages of the documentation runs, after what each page presupposes."""

from __future__ import annotations

from pathlib import Path

import pytest

from pages.reader import compare
from pages.test_pages import ROOT, blocks

BEFORE = {
    "index": "",
    "control": """
import numpy as np, rrrgen
m = rrrgen.compile("puma560")
q, dq, ddq = np.random.default_rng(1).uniform(-1, 1, (3, 6))
""",
    "inverse-kinematics": """
import numpy as np, rrrgen
m = rrrgen.compile("puma560")
q = np.array([0.1, 0.6, -0.4, 0.5, 0.8, -0.2])
T = m.forward_kinematics(q)
poses = np.stack([T, T])
T_far = T.copy()
T_far[:3, 3] *= 9
""",
    "controller": "",
    "from-a-csv": "",
    "other-formats": "",
    "trees": """
import shutil
from pages.test_pages import ROOT
shutil.copytree(ROOT / "examples/trees", "examples/trees")
""",
    "linkages": """
import shutil
from pages.test_pages import ROOT
for name in ("palletiser", "excavator", "press", "linkages"):
    shutil.copytree(ROOT / "examples" / name, f"examples/{name}")
""",
    "second-derivatives": """
import shutil
from pages.test_pages import ROOT
shutil.copytree(ROOT / "examples/trees", "examples/trees")
""",
    "quick-start": "q = dq = ddq = [0.1, 0.2, 0.3]",
    "path-timing": "",
    "python": "",
    "identification": "",
    "online-estimation": """
import numpy as np, rrrgen
m = rrrgen.compile("rrr")
q, dq, ddq = np.random.default_rng(1).uniform(-1, 1, (3, 20, 3))
tau = m.inverse_dynamics(q, dq, ddq)
""",
}
"""Page -> what its first block presupposes, as the text around it says."""

AFTER = {
    "controller": "assert c.modes[out.mode] == 'gravity' and not c.faults(out.status)",
    "control": "assert np.abs(tau - m.inverse_dynamics(q, dq, ddq)).max() > 1",
    "inverse-kinematics": "assert np.abs(np.array(q).ravel() - answer.q[0]).max() < 1e-9",
    "path-timing": "assert motion.q_d.shape == (len(np.arange(0, timed.duration, 1e-3)), 7)",
    "other-formats": "assert rrrgen.load_spec('puma.yaml').n == 6",
    "python": "assert abs(float(result[result.names[0]]) / model.beta[0] - 1) < 0.02 and identified.n == 2",
    "identification": "assert len(files) == 2",
    "second-derivatives": """
assert H_of_quad.shape == (54, 54) and np.abs(product - H_of_quad[3]).max() < 1e-12 * np.abs(H_of_quad).max()
at, w = np.r_[q, dq, 1, 2, 3], [0.1, 0.2, 0.3]
expected = m.forward_dynamics_hessian(q, dq, at[6:], w).H
assert np.abs(ca.Function("H", [x, weights], [H])(at, w).full() - expected).max() < 1e-10 * np.abs(expected).max()
""",
    "linkages": """
assert tau.shape == (4,) and abs(m.forward_kinematics([0.2, 0.3, 0.8, 0.1])[2, 2] + 1) < 1e-12
x, y = 2.6 * np.cos(q[1]) - 0.55 * np.sin(q[1]) - 0.5, 2.6 * np.sin(q[1]) + 0.55 * np.cos(q[1]) + 0.45
assert abs(length[0] - np.hypot(x, y)) < 1e-12 and 1e5 < force[0] < 2e5
assert gap < 1e-14 and torque.shape == (1,)
assert abs(passive[1, 0] - 0.28 * np.sin(np.arccos(0.05 / 0.28))) < 1e-12 and abs(W[1, 0] + 0.06) < 1e-12
""",
    "trees": """
falling = m.floating_inverse_dynamics(q, dq, fall.ddq, [0, 0, 0, 1], np.zeros(6), fall.twist_rate)
assert abs(falling.wrench).max() < 1e-9 and abs(falling.tau - held.tau).max() < 1e-9
""",
    "online-estimation": "assert estimator.parameters.shape == (13,)",
}
"""Page -> a check of what its blocks computed."""

PRINTED = ("index",)
"""Pages that show what their Python prints."""

ELSEWHERE = ('read_response_models("runs/', "import rrr_model")
"""Blocks that need a run folder or an installed wheel; other tests call these functions."""


@pytest.mark.parametrize("page", BEFORE)
def test_python_on_the_page_runs(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if page == "other-formats":
        pytest.importorskip("roboticstoolbox", reason="the extra test is not installed")
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {}
    texts = list(blocks((ROOT / f"docs/{page}.md").read_text(encoding="utf-8"), "python"))
    own = [text for text in texts if not any(mark in text for mark in ELSEWHERE)]
    assert own
    for text in (BEFORE[page], *own, AFTER.get(page, "")):
        exec(compile(text, f"{page}.md", "exec"), space)  # our own page
    if page in PRINTED:
        (shown,) = blocks((ROOT / f"docs/{page}.md").read_text(encoding="utf-8"), "text")
        compare(shown, capsys.readouterr().out)


def test_every_page_with_python_is_run() -> None:
    pages = {
        page.stem
        for page in ROOT.glob("docs/*.md")
        if any(
            not any(mark in text for mark in ELSEWHERE) for text in blocks(page.read_text(encoding="utf-8"), "python")
        )
    }
    tutorials = {"first-model", "first-identification", "first-calibration", "optimal-control"}
    assert pages - tutorials - {"sockets"} == set(BEFORE)
