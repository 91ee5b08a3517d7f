"""Figures: two files, print resolution, the same bytes for the same data."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

from rrrgen.lab.data.figure_style import new_figure, save_figure, style_axes


def test_pixels_are_enough_for_print(tmp_path: Path, print_resolution: None) -> None:
    figure, (axis,) = new_figure(1, 1, 3.0, width=7.0)
    axis.plot([0.0, 1.0], [0.0, 2.0])
    style_axes(axis, "t in s", "q in rad")
    first = [path.read_bytes() for path in save_figure(figure, tmp_path / "one")]
    again = [path.read_bytes() for path in save_figure(figure, tmp_path / "two")]
    assert [path.suffix for path in sorted(tmp_path.iterdir())] == [".png", ".svg"] * 2
    assert first == again
    width, height = struct.unpack(">II", first[1][16:24])  # of the header of a PNG
    assert (width, height) == (2100, 900)
