"""The result of a calibration as text, as plain data and as a figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import option_name
from rrrgen.lab.calibrate.estimation import USED, Calibration
from rrrgen.lab.calibrate.measurements import COUNT, Measurements
from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.estimate.statistics import rms

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAUSIBLE = (0.7, 1.4)
"""Range of chi^2 per degree of freedom outside which the stated noise, or the model, must be wrong; with few degrees of
freedom it is widened by three standard deviations."""
SPOILT = 8.0
"""Largest over median residual above which a warning points to outliers; of 200 normal ones it is 2 to 4."""


def to_data(calibration: Calibration, measured: Measurements, inside: Array) -> dict[str, Any]:
    """Convert the result of a calibration to plain data for JSON, in m and rad.

    ``inside`` (N, joints) are joint positions inside the limits, at which the error of the tip is predicted.
    """
    rms, worst = _expected_errors(calibration, inside)
    kept = zip(calibration.chosen.kept, calibration.change, calibration.deviation, strict=True)
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
        "left_out": calibration.chosen.left_out,
        "rms": {key: float(value) for key, value in _rms(calibration.residuals[calibration.weights >= USED]).items()},
        "rms_before": {key: float(value) for key, value in _rms(calibration.before).items()},
        "expected_error": {"rms": rms, "rms_at_the_worst_posture": worst},
        "deviations_raised_by": calibration.misfit,
        "chi2_per_dof": calibration.chi2_per_dof,
        "condition": calibration.condition,
        "observability": calibration.observability,
        "outliers": [k + 1 for k in calibration.outliers],
    }


def _rms(residuals: Array) -> dict[str, Any]:
    """Root mean squares of the position error (m) and, where orientations were measured, of its angle (rad)."""
    lengths = np.sqrt(np.mean(np.sum(residuals[:, :3] ** 2, axis=1)))
    if residuals.shape[1] < COUNT["pose"]:
        return {"length": lengths}
    return {"length": lengths, "angle": np.sqrt(np.mean(np.sum(residuals[:, 3:] ** 2, axis=1)))}


def to_text(calibration: Calibration, measured: Measurements, inside: Array) -> str:
    """Print the result of a calibration as text.

    It states the errors before and after, whether to trust them, which error of the tip is to be expected at the joint
    positions ``inside`` (N, joints), the parameters with their standard deviations, and which of them were left out.
    """
    before, after = _rms(calibration.before), _rms(calibration.residuals[calibration.weights >= USED])
    lines = [f"{len(measured.q)} measurements ({measured.kind}), {len(calibration.chosen.kept)} parameters"]
    lines.append(f"rms error of length: {before['length'] * 1e3:.4g} mm before, {after['length'] * 1e3:.4g} mm after")
    if "angle" in before:
        lines.append(
            f"rms error of angle:  {before['angle'] * 1e3:.4g} mrad before, {after['angle'] * 1e3:.4g} mrad after"
        )
    lines.append(f"chi^2 per degree of freedom {calibration.chi2_per_dof:.3g}, condition {calibration.condition:.3g}, "
                 f"observability {calibration.observability:.3g}")  # fmt: skip
    rms, worst = _expected_errors(calibration, inside)
    lines.append(
        f"expected error of the tip inside the joint limits: {1e3 * rms:.3g} mm rms, {1e3 * worst:.3g} mm rms in the "
        "worst posture (single errors are up to three times as large)"
    )
    lines += _doubts(calibration, measured)
    if calibration.chi2_per_dof > PLAUSIBLE[1]:
        lines.append(
            f"deviations and expected errors are raised {calibration.misfit:.3g} times above those of the stated "
            "noise, as the residuals are"
        )
    if calibration.outliers:
        lines.append(f"set aside as outliers: measurements {', '.join(str(k + 1) for k in calibration.outliers)}")
    lines += ["", f"{'parameter':<12}{'change':>12}{'deviation':>12}"]
    for entry, change, deviation in zip(
        calibration.chosen.kept, calibration.change, calibration.deviation, strict=True
    ):
        unit = "1e-3" if entry.unit == "1" else f"m{entry.unit}"
        lines.append(f"{entry.name:<12}{change * 1e3:>12.4f}{deviation * 1e3:>12.4f} {unit}")
    lines += ["", "not distinguished by these measurements, and left as they are:"]
    lines += [f"  {name}: {reason}" for name, reason in calibration.chosen.left_out.items()]
    return "\n".join(lines) + "\n"


def _expected_errors(calibration: Calibration, inside: Array) -> tuple[float, float]:
    """Expected rms error of the tip, in m: over the postures ``inside``, and in the worst of them."""
    expected = calibration.position_deviation(inside)
    return float(rms(expected)), float(expected.max())


def _doubts(calibration: Calibration, measured: Measurements) -> list[str]:
    """A warning if the residuals do not fit the stated noise, with what would mend it."""
    widened = 3 * np.sqrt(2 / max(calibration.degrees_of_freedom, 1))
    if PLAUSIBLE[0] - widened < calibration.chi2_per_dof < PLAUSIBLE[1] + widened:
        return []
    stated = f"{option_name('sigma')} {measured.sigma:g} m" + (
        f", {option_name('sigma_angle')} {measured.sigma_angle:g} rad" * (measured.kind == "pose")
    )
    lines = [f"warning: the residuals do not fit the stated noise ({stated})"]
    sizes = np.linalg.norm(calibration.residuals * measured.weights, axis=1)
    sizes[calibration.weights < USED] = 0.0
    worst = int(np.argmax(sizes))
    if sizes[worst] > SPOILT * np.median(sizes[sizes > 0]):
        length = np.linalg.norm(calibration.residuals[worst, :3])
        return [
            *lines,
            f"  measurement {worst + 1} is off by {1e3 * length:.3g} mm; {option_name('robust')} sets outliers aside",
        ]
    used = calibration.residuals[calibration.weights >= USED]
    share = np.sqrt(used.size / max(calibration.degrees_of_freedom, 1))
    noise = f"{option_name('sigma')} {share * rms(used[:, :3]):.2g}"
    if measured.kind == "pose":
        noise += f" {option_name('sigma_angle')} {share * rms(used[:, 3:]):.2g}"
    return [
        *lines,
        f"  {noise} would fit, if the device is no better; otherwise the arm has errors that no table states",
    ]


def plot_residuals(calibration: Calibration, measured: Measurements) -> Figure:
    """Plot the error of each measurement before and after calibration, and each parameter with its deviation."""
    parts = [("position error (mm)" if COUNT[measured.kind] >= 3 else "error (mm)", slice(0, 3), measured.sigma)]
    if measured.kind == "pose":
        parts += [("orientation error (mrad)", slice(3, 6), measured.sigma_angle)]
    figure, axes = new_figure(len(parts) + 1, 1, 2.6 * len(parts) + 3.4)
    numbers = np.arange(1, len(measured.q) + 1)
    for axis, (label, part, noise) in zip(axes, parts, strict=False):
        components = calibration.residuals[:, part].shape[1]
        axis.axhline(
            1e3 * noise * np.sqrt(components), linewidth=0.8, linestyle="--", color="0.5", label="stated noise"
        )
        for residuals, name, mark in ((calibration.before, "before", "o"), (calibration.residuals, "after", ".")):
            axis.semilogy(numbers, np.linalg.norm(residuals[:, part], axis=1) * 1e3, mark, markersize=4, label=name)
        if calibration.outliers:
            places = [k + 1 for k in calibration.outliers]
            sizes = np.linalg.norm(calibration.residuals[calibration.outliers][:, part], axis=1) * 1e3
            axis.semilogy(places, sizes, "x", markersize=8, label="set aside")
        style_axes(axis, "measurement" if axis is axes[len(parts) - 1] else "", label)
    _plot_parameters(calibration, axes[-1])
    for axis in (axes[0], axes[-1]):
        axis.legend(ncols=4, fontsize="small", frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderpad=0)
    return figure


def _plot_parameters(calibration: Calibration, axis: Any) -> None:
    """Plot size of change and deviation of each parameter: one whose change is below its deviation is uncertain."""
    names = [entry.name for entry in calibration.chosen.kept]
    places = np.arange(len(names))
    axis.semilogy(places, 1e3 * np.abs(calibration.change), "o", markersize=4, label="change")
    axis.semilogy(places, 1e3 * calibration.deviation, "_", markersize=7, color="black", label="standard deviation")
    axis.set_xticks(places, names, rotation=90, fontsize="small")
    units = dict.fromkeys("1e-3" if entry.unit == "1" else f"m{entry.unit}" for entry in calibration.chosen.kept)
    style_axes(axis, "", f"parameter ({', '.join(units)})")
