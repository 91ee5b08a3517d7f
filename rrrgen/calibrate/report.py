"""The result of a calibration as text, as plain data and as a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.calibrate.estimation import Calibration
from rrrgen.calibrate.measurements import COUNT, Measurements
from rrrgen.runs.figures import new_figure, save_figure, style_axes

PLAUSIBLE = (0.7, 1.4)
"""Range of chi^2 per degree of freedom outside which the stated noise, or the model, must be wrong."""


def to_data(found: Calibration, measured: Measurements) -> dict[str, Any]:
    """Convert the result of a calibration to plain data for JSON, in m and rad."""
    kept = zip(found.chosen.kept, found.change, found.deviation, strict=True)
    return {
        "measured": measured.kind,
        "measurements": len(measured.q),
        "parameters": {
            entry.name: {
                "change": float(change),
                "deviation": float(deviation),
                "unit": entry.unit,
            }
            for entry, change, deviation in kept
        },
        "left_out": found.chosen.left_out,
        "rms": {key: float(value) for key, value in _rms(found.residuals[found.weights >= 0.1]).items()},
        "rms_before": {key: float(value) for key, value in _rms(found.before).items()},
        "chi2_per_dof": found.chi2_per_dof,
        "condition": found.condition,
        "observability": found.observability,
        "outliers": [k + 1 for k in found.outliers],
    }


def _rms(residuals: Array) -> dict[str, Any]:
    """Root mean squares of the position error (m) and, where orientations were measured, of its angle (rad)."""
    lengths = np.sqrt(np.mean(np.sum(residuals[:, :3] ** 2, axis=1)))
    if residuals.shape[1] < COUNT["pose"]:
        return {"length": lengths}
    return {"length": lengths, "angle": np.sqrt(np.mean(np.sum(residuals[:, 3:] ** 2, axis=1)))}


def to_text(found: Calibration, measured: Measurements) -> str:
    """Print the result of a calibration as text.

    It states the errors before and after, whether to trust them, the parameters with their standard deviations, and
    which parameters were left out.
    """
    before, after = _rms(found.before), _rms(found.residuals[found.weights >= 0.1])
    lines = [f"{len(measured.q)} measurements ({measured.kind}), {len(found.chosen.kept)} parameters"]
    lines.append(f"rms error of length: {before['length'] * 1e3:.4g} mm before, {after['length'] * 1e3:.4g} mm after")
    if "angle" in before:
        lines.append(
            f"rms error of angle:  {before['angle'] * 1e3:.4g} mrad before, {after['angle'] * 1e3:.4g} mrad after"
        )
    lines.append(f"chi^2 per degree of freedom {found.chi2_per_dof:.3g}, condition {found.condition:.3g}, "
                 f"observability {found.observability:.3g}")  # fmt: skip
    if not PLAUSIBLE[0] < found.chi2_per_dof < PLAUSIBLE[1]:
        stated = f"--sigma {measured.sigma:g} m, --sigma-angle {measured.sigma_angle:g} rad"
        lines.append(f"warning: the residuals do not fit the stated noise ({stated}); deviations scale with it")
    if found.outliers:
        lines.append(f"set aside as outliers: measurements {', '.join(str(k + 1) for k in found.outliers)}")
    lines += ["", f"{'parameter':<12}{'change':>12}{'deviation':>12}"]
    for entry, change, deviation in zip(found.chosen.kept, found.change, found.deviation, strict=True):
        unit = "1e-3" if entry.unit == "1" else f"m{entry.unit}"
        lines.append(f"{entry.name:<12}{change * 1e3:>12.4f}{deviation * 1e3:>12.4f} {unit}")
    lines += ["", "not told apart by these measurements, and left as they are:"]
    lines += [f"  {name}: {reason}" for name, reason in found.chosen.left_out.items()]
    return "\n".join(lines) + "\n"


def plot_residuals(found: Calibration, measured: Measurements, stem: Path) -> list[Path]:
    """Plot the error of each measurement before and after calibration as SVG and PNG; returns the paths."""
    parts = [("position error (mm)" if measured.kind in ("pose", "point") else "error (mm)", slice(0, 3))]
    parts += [("orientation error (mrad)", slice(3, 6))] if measured.kind == "pose" else []
    figure, axes = new_figure(len(parts), 1, 2.6 * len(parts) + 0.4)
    numbers = np.arange(1, len(measured.q) + 1)
    for axis, (label, part) in zip(axes, parts, strict=True):
        for residuals, name, mark in ((found.before, "before", "o"), (found.residuals, "after", ".")):
            axis.semilogy(numbers, np.linalg.norm(residuals[:, part], axis=1) * 1e3, mark, markersize=4, label=name)
        if found.outliers:
            places = [k + 1 for k in found.outliers]
            sizes = np.linalg.norm(found.residuals[found.outliers][:, part], axis=1) * 1e3
            axis.semilogy(places, sizes, "x", markersize=8, label="set aside")
        style_axes(axis, "measurement" if axis is axes[-1] else "", label)
    axes[0].legend(ncols=3, fontsize="small")
    return save_figure(figure, stem)
