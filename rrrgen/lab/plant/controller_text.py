"""Writer of the controller of a simulated experiment, as a file that ``rrrgen identify --controller`` reads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.plant.controllers import PD, DeviationFilter
from rrrgen.lab.plant.experiment import Instruments, Recording

RECORDS = {"centred": "centred", "command": "applied"}
"""The word of the controller file for the torque that a recording holds, by ``Instruments.torque_record``."""


def controller_text(recording: Recording, joints: Sequence[str], instruments: Instruments) -> str | None:
    """Write the controller of ``recording`` as the text of a controller file; None where the format cannot express it.

    It can express PD control with a Kalman observer, with drives whose torques are neither rounded nor limited at
    coupled motors.
    """
    controller, observer = recording.loop or (None, None)
    plain = instruments.motors is None and instruments.torque_resolution is None
    if not isinstance(controller, PD) or not isinstance(observer, DeviationFilter) or not plain:
        return None
    lines = [
        *("schema: rrrgen-controller/1", "description: PD control (14.33) with a Kalman observer of the deviation"),
        *(f"period: {recording.period!r} s", f"delay: {instruments.delay}"),
        *(f"records: {RECORDS[instruments.torque_record]}", "joints:"),
    ]
    n = len(joints)
    fed = "" if recording.feedforward is None else ", feedforward: 1"
    E, k = np.broadcast_to(observer.E, (n, 3, 3)), np.broadcast_to(observer.k, (n, 3))
    for i, name in enumerate(joints):
        position, speed, denominator = _filters(E[i], k[i])
        lines += [
            f"  - name: {name}",
            "    signals:",
            "      deviation: {sum: {position: 1, reference: -1}}",
            f"      e: {{filter: deviation, numerator: {position}, denominator: {denominator}}}",
            f"      de: {{filter: deviation, numerator: {speed}, denominator: {denominator}}}",
            f"      command: {{sum: {{e: {-controller.kp[i]!r}, de: {-controller.kd[i]!r}{fed}}}}}",
        ]
        if instruments.torque_limit is not None:
            lines.append(f"      limited: {{limit: command, to: {float(instruments.torque_limit[i])!r}}}")
        lines.append(f"    torque: {'command' if instruments.torque_limit is None else 'limited'}")
    return "\n".join(lines) + "\n"


def _filters(E: Array, k: Array) -> tuple[list[float], list[float], list[float]]:
    """The transfer functions of the filter: numerators to the filtered deviation and its rate, and the denominator.

    All are coefficients in powers of 1/z. The filter with transition matrix ``E`` and gain ``k`` predicts the state
    x_hat of the deviation e: ``x_bar = (I - k c) x_hat + k e``, ``x_hat(k+1) = E x_bar``, c = [1, 0, 0].
    """
    from scipy.signal import ss2tf

    kept = np.eye(3) - np.outer(k, [1.0, 0.0, 0.0])
    numerators, denominator = ss2tf(E @ kept, (E @ k)[:, None], kept[:2], k[:2, None])
    return numerators[0].tolist(), numerators[1].tolist(), denominator.tolist()
