"""The C header ``<name>_contact.h``: what recordings without contact tell, as initializers of arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rrrgen.lab.contact.recordings import ContactFindings


def contact_header(name: str, found: ContactFindings) -> str:
    """Text of the header of the robot ``name``.

    The emitted function ``<name>_contact`` takes the thresholds, ``<name>_external_force`` and
    ``<name>_external_wrench`` take the covariance.
    """
    macro = name.upper()
    limits, covariance = found.thresholds, np.ravel(found.covariance.matrix)
    return (
        f"/* {name}_contact.h: thresholds of contact detection, by rrrgen contact-thresholds.\n *\n"
        f" *     static const {name}_real threshold[{macro}_N] = {macro}_CONTACT_THRESHOLDS;\n"
        f" *     static const {name}_real change_threshold[{macro}_N] = {macro}_CONTACT_CHANGE_THRESHOLDS;\n"
        f" *     static const {name}_real covariance[{macro}_N * {macro}_N] = {macro}_CONTACT_COVARIANCE;\n *\n"
        " * They hold for the observer pole, the period and the speed filter that they were found with.\n */\n"
        f"#ifndef {macro}_CONTACT_H\n#define {macro}_CONTACT_H\n\n"
        f"#define {macro}_CONTACT_THRESHOLDS {_listed(limits.levels)} /* of the residuals, N m | N */\n"
        f"#define {macro}_CONTACT_CHANGE_THRESHOLDS {_listed(limits.change_levels)} /* of their changes, N m | N */\n"
        f"#define {macro}_CONTACT_COVARIANCE {_listed(covariance)} /* of the residuals, by rows */\n"
        f"#define {macro}_CONTACT_GAIN {found.gain:.9g} /* pole of the momentum observer, 1/s */\n"
        f"#define {macro}_CONTACT_PERIOD {found.period:.9g} /* s */\n\n#endif\n"
    )


def _listed(values: Iterable[float]) -> str:
    return "{ " + ", ".join(f"{value:.9g}" for value in values) + " }"
