"""The section ``provenance`` of a robot file: which recorded samples its parameters were fitted to.

It is written by ``rrrgen identify`` and used by ``rrrgen validate`` only.
"""

from __future__ import annotations

import re
from itertools import pairwise

from rrrgen.base.yamltext.document import FaultList, Node, Scalar
from rrrgen.base.yamltext.sections import describe, read_choice, read_list, read_section, read_text, shorten
from rrrgen.robot.file.fields import FIT, HASH_DIGITS, MAX_FITS, ROBOT_FILE
from rrrgen.robot.robot_spec import FitSpec

_KEYS = {key.name: key for key in FIT}


def read_provenance(node: Node, faults: FaultList) -> tuple[FitSpec, ...]:
    """Read the section ``provenance``: one entry per fit; faults are added to ``faults``."""
    items = read_list(node, "provenance", None, faults) or []
    if len(items) > MAX_FITS:
        faults.error(node, f"provenance has {len(items)} fits", f"at most {MAX_FITS}")
        return ()
    found = [_read_fit(item, f"fit {number} of provenance", faults) for number, item in enumerate(items, start=1)]
    return tuple(fit for fit in found if fit is not None)


def _read_fit(node: Node, what: str, faults: FaultList) -> FitSpec | None:
    values = read_section(node, "fit", what, faults, ROBOT_FILE)
    if values is None or "fingerprint" not in values or "windows" not in values or "method" not in values:
        return None  # whose fault has been recorded
    method = read_choice(values["method"], _KEYS["method"], faults)
    windows = _whole_number(values["windows"], f"windows of {what}", faults)
    hashes = _read_hashes(values["fingerprint"], f"the fingerprint of {what}", faults)
    texts = {
        name: read_text(values[name], name, faults) for name in ("program", "recordings", "data") if name in values
    }
    if method is None or windows is None or hashes is None:
        return None
    if windows < len(hashes):
        faults.error(values["windows"], f"windows of {what} is {windows}, fewer than its {len(hashes)} hashes")
        return None
    return FitSpec(hashes, windows, **texts)


def _whole_number(node: Node, what: str, faults: FaultList) -> int | None:
    if isinstance(node, Scalar) and re.fullmatch(r"\d{1,15}", node.text):
        return int(node.text)
    faults.error(node, f"{what} is {describe(node)}, not a whole number")
    return None


def _read_hashes(node: Node, what: str, faults: FaultList) -> tuple[int, ...] | None:
    """Read a list of lines, each with one or more hexadecimal hashes; all hashes must be in rising order."""
    lines = read_list(node, what, None, faults)
    if lines is None:
        return None
    found: list[int] = []
    for line in lines:
        text = line.text if isinstance(line, Scalar) else ""
        if not text or len(text) % HASH_DIGITS or not re.fullmatch(r"[0-9a-f]+", text):
            shown = f"'{shorten(text, 20)}'" if text else describe(line)
            faults.error(
                line, f"{what} has the line {shown}", f"hashes of {HASH_DIGITS} hexadecimal digits, side by side"
            )
            return None
        found += [int(text[i : i + HASH_DIGITS], 16) for i in range(0, len(text), HASH_DIGITS)]
    if any(a >= b for a, b in pairwise(found)):
        faults.error(node, f"the hashes of {what} are not in rising order", "the section is written by rrrgen identify")
        return None
    return tuple(found)
