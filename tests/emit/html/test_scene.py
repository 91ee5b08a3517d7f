"""Motions and figures in the report: thinned, checked, embedded."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.emit.html.scene import LARGEST_DRAWING, SAMPLES, PlayedMotion, illustrations, scene
from rrrgen.robot.file import load_spec


def test_long_motions_are_thinned_and_keep_both_ends() -> None:
    t = 5.0 + np.arange(40_001) / 1000
    data = PlayedMotion("long", t, np.stack([np.sin(t), t], axis=1)).as_data(2)
    assert len(data["t"]) == len(data["q"]) == SAMPLES
    assert data["t"][0] == 0.0
    assert data["t"][-1] == 40.0
    assert np.diff(data["t"]).max() < 0.03
    np.testing.assert_allclose(data["q"], np.stack([np.sin(t0 := np.array(data["t"]) + 5.0), t0], axis=1), atol=1e-5)


@pytest.mark.parametrize(
    ("t", "q", "message"),
    [
        ([0.0, 1.0], np.zeros((2, 3)), "2 joints"),
        ([0.0, 1.0], np.zeros((3, 2)), "2 joints"),
        ([0.0], np.zeros((1, 2)), "two finite samples"),
        ([0.0, 0.0], np.zeros((2, 2)), "two finite samples"),
        ([0.0, 1.0], np.array([[0.0, 0.0], [np.nan, 0.0]]), "two finite samples"),
    ],
)
def test_what_cannot_be_played_is_refused(t: list[float], q: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        PlayedMotion("broken", np.array(t), q).as_data(2)


def test_figures_are_embedded_large_drawings_as_pixels(tmp_path: Path) -> None:
    folder = tmp_path / "run" / "figures"
    folder.mkdir(parents=True)
    with pytest.raises(InputError, match="holds no figures"):
        illustrations(tmp_path / "run")
    (folder / "joint_torques.svg").write_text("<svg/>", encoding="utf-8")
    (folder / "points.svg").write_text("x" * (LARGEST_DRAWING + 1), encoding="utf-8")
    (folder / "points.png").write_bytes(b"pixels")
    torques, points = illustrations(tmp_path / "run")
    assert torques.caption == "run: joint torques"
    assert torques.address == "data:image/svg+xml;base64," + base64.b64encode(b"<svg/>").decode()
    assert points.address == "data:image/png;base64," + base64.b64encode(b"pixels").decode()


def test_the_view_has_every_named_tip() -> None:
    hand = load_spec(Path(__file__).resolve().parents[3] / "examples" / "trees" / "hand.yaml")
    shown = scene(hand)["tips"]
    assert [(tip["carrier"], tip["joints"]) for tip in shown] == [(1, [2, 3, 4]), (1, [5, 6, 7])]
    assert [(tip["name"], hand.rows[tip["row"]].name, tip["tool"][0][3]) for tip in shown] == [
        ("finger", "f3", 0.03), ("thumb", "t3", 0.025)
    ]  # fmt: skip
