"""Options and files of the online estimators that ``rrrgen generate`` writes beside the model."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit.controller.programs import Regression

F = TypeVar("F", bound=Callable[..., Any])

KINDS = ("rls", "gradient")


def estimator_options(function: F) -> F:
    """Add the options of the online estimators."""
    positive = click.FloatRange(min=0.0, min_open=True)
    options = [
        click.option(
            "--estimator",
            "estimators",
            type=click.Choice(KINDS),
            multiple=True,
            help="Also write <name>_rls.h/.c or <name>_gradient.h/.c, which estimate the parameters sample by sample.",
        ),
        click.option(
            "--fix",
            metavar="NAME=VALUE",
            multiple=True,
            help="A parameter that the estimators take as known; repeat for several.",
        ),
        click.option(
            "--torque-noise",
            metavar="NM[,NM..]",
            help="Standard deviation of the torque noise in N m (N), one for all joints or one each; default 0.1.",
        ),
        click.option(
            "--spread",
            type=positive,
            metavar="STD",
            help="Standard deviation of all parameters at the start, SI; default ten times the largest nominal one.",
        ),
        click.option(
            "--forgetting",
            type=click.FloatRange(0.0, 1.0, min_open=True),
            help="Forgetting factor of the least squares, 1 to forget nothing; default 0.999.",
        ),
        click.option(
            "--gain",
            type=positive,
            metavar="ALPHA",
            help="Gain alpha of the gradient (14.23), 1/s; default: a tenth of its bound along --trajectory.",
        ),
        click.option(
            "--rest-speed",
            type=click.FloatRange(min=0.0),
            metavar="SPEED",
            help="Joints slower than this, rad/s (m/s), are left out of the estimation; default 0.01.",
        ),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def estimator_files_of(model: DerivedModel, options: dict[str, Any]) -> dict[str, str]:
    """The C files of the chosen estimators; raises UsageError for options without an estimator that uses them."""
    kinds = tuple(dict.fromkeys(options["estimators"]))
    _refuse_unused(kinds, options)
    if not kinds:
        return {}
    from dataclasses import replace

    from rrrgen.emit.controller.programs import regression
    from rrrgen.emit.controller.sources import EstimatorSettings, estimator_files

    setting = regression(model, _fixed(options["fix"]))
    given = {"forgetting": options["forgetting"], "rest": options["rest_speed"]}
    settings = EstimatorSettings(**{name: value for name, value in given.items() if value is not None})
    if options["torque_noise"] is not None:
        settings = replace(settings, noise=_covariance(options["torque_noise"], model.spec.n))
    if options["spread"] is not None:
        settings = replace(settings, spread=(options["spread"],) * len(setting.names))
    if "gradient" in kinds:
        settings = replace(settings, gain=_gain(setting, options))
    files: dict[str, str] = {}
    for kind in kinds:
        files |= estimator_files(setting, kind, settings, options["real"])
    return files


def _refuse_unused(kinds: tuple[str, ...], options: dict[str, Any]) -> None:
    """Raise UsageError for an option that no chosen estimator has."""
    users = {
        "fix": KINDS,
        "rest_speed": KINDS,
        "torque_noise": ("rls",),
        "spread": ("rls",),
        "forgetting": ("rls",),
        "gain": ("gradient",),
    }
    for name, having in users.items():
        if options[name] not in (None, ()) and not set(having) & set(kinds):
            option = f"--{name.replace('_', '-')}"
            raise click.UsageError(f"{option} belongs to --estimator {' or '.join(having)}")


def _gain(setting: Regression, options: dict[str, Any]) -> float:
    """The gain alpha Ts of the gradient estimator; along a given motion it must be below the bound of stability."""
    from rrrgen.base.errors import InputError
    from rrrgen.emit.controller.gain import chosen_gain, gain_bound
    from rrrgen.lab.design.fourier_series import read_trajectory

    bound = None
    if options["trajectory"] is not None:
        motion = read_trajectory(options["trajectory"])
        if motion.n != setting.joints:
            raise InputError(f"{options['trajectory']} moves {motion.n} joints, the robot has {setting.joints}")
        bound = gain_bound(setting, *motion.evaluate(motion.times(1.0 / options["rate"])))
    stated = None if options["gain"] is None else options["gain"] / options["rate"]
    if stated is None and bound is None:
        raise click.UsageError("--estimator gradient needs --gain, or the --trajectory along which it is chosen")
    return chosen_gain(stated, bound)


def _fixed(entries: tuple[str, ...]) -> dict[str, float]:
    fixed = {}
    for entry in entries:
        name, _, value = entry.partition("=")
        try:
            fixed[name.strip()] = float(value)
        except ValueError:
            raise click.BadParameter(f"'{entry}' is not NAME=VALUE", param_hint="--fix") from None
    return fixed


def _covariance(text: str, joints: int) -> tuple[tuple[float, ...], ...]:
    """Make the diagonal covariance matrix from the standard deviations listed in ``text``, one per joint."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) == 1:
        values = values * joints
    if len(values) != joints or not all(math.isfinite(value) and value > 0.0 for value in values):
        message = f"'{text}' is neither one positive number nor {joints}, as in 0.2,0.1,.."
        raise click.BadParameter(message, param_hint="--torque-noise")
    return tuple(tuple(values[i] ** 2 * (i == j) for j in range(joints)) for i in range(joints))
