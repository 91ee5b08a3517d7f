"""Rule: negative friction or inertia means that the torque or the position of the joint has the wrong sign.

Reversing both signals of a joint, or one signal of a joint that is decoupled from the others, leaves the error of the
fit unchanged; only the signs of friction and inertia reveal it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.magnitude import gravity_and_inertia
from rrrgen.lab.identify.diagnosis.sample import Sample
from rrrgen.lab.identify.diagnosis.trial import AllTerms, Fit

CLEAR = 6.0
"""Standard deviations, of white residuals: twice that for residuals correlated over four samples."""
SHARE = 0.01  # of the joint's RMS torque: smaller friction or inertia torques are not judged


def dissipation(regressor: AllTerms, sample: Sample, fit: Fit, words: Wording) -> Iterator[Cause]:
    """Report joints whose friction or inertia is significantly negative in ``fit``."""
    names = list(regressor.names)
    _, M = gravity_and_inertia(regressor, sample, fit.theta)
    tau = np.sqrt(np.mean(sample.tau**2, axis=0))
    for i, joint in enumerate(words.joints):
        speed, push = (float(np.sqrt(np.mean(x[:, i] ** 2))) for x in (sample.dq, sample.ddq))
        at = [names.index(f"{key}{i + 1}") for key in ("fv", "fc")]
        # mean friction torque against the motion, at the joint's RMS speed
        weights = np.zeros(len(names))
        weights[at] = speed, 1.0
        friction = float(weights @ fit.theta)
        doubt = float(np.sqrt(np.maximum(0.0, weights @ fit.covariance @ weights)))
        drives = friction < -max(CLEAR * doubt, SHARE * tau[i])
        slows = friction > max(CLEAR * doubt, SHARE * tau[i])
        inertia = float(np.mean(M[:, i]))
        backwards = inertia * push < -max(SHARE * tau[i], fit.error[i] * tau[i])
        forwards = inertia * push > max(SHARE * tau[i], fit.error[i] * tau[i])
        if (drives and not forwards) or (backwards and not slows):
            unit = ("N m", "kg m^2") if words.revolute[i] else ("N", "kg")
            yield words.wrong_sign(["torque", "position"], i).because(
                f"friction of {joint} at its RMS speed {friction:.3g} {unit[0]} (deviation {doubt:.1g}), inertia "
                f"{inertia:.3g} {unit[1]}: both must be positive"
            )
