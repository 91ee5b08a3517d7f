"""Units of the columns of a recording, as factors to SI and radians."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from rrrgen.yamltext.document import FaultList, Node, Scalar
from rrrgen.yamltext.sections import describe
from rrrgen.yamltext.suggest import did_you_mean

TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
RATE = {"Hz": 1.0, "kHz": 1e3}
ANGLE = {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180.0, "rev": 2.0 * math.pi}
LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
POSITION = ANGLE | LENGTH
VELOCITY = {f"{name}/s": factor for name, factor in POSITION.items()} | {"rpm": math.pi / 30.0}
ACCELERATION = {f"{name}/s^2": factor for name, factor in POSITION.items()}
TORQUE = {"N*m": 1.0, "mN*m": 1e-3, "kN*m": 1e3, "N*cm": 1e-2, "N*mm": 1e-3}
FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
CONSTANT = {"N*m/A": 1.0, "mN*m/A": 1e-3, "N/A": 1.0, "N*m/V": 1.0, "N/V": 1.0}

# what a torque column may hold; A and V need a constant, % needs the rated value
DRIVE_SIGNALS = {"A": 1.0, "mA": 1e-3, "V": 1.0, "%": 0.01, "one": 1.0}
COUNTS = "counts"


def spelled(unit: str) -> str:
    """``Nm``, ``N m`` and ``N·m`` alike: the spelling without blanks and product signs."""
    text = unit.strip().replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("²", "^2")
    return re.sub(r"[\s*·^]+", "", text.replace("**", "^"))


_SPELLINGS = {"degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "turn": "rev", "turns": "rev"}


def find(unit: str, table: Mapping[str, float]) -> str | None:
    """The name in ``table`` of a unit as somebody spelled it, or None."""
    known = {spelled(name): name for name in table}
    key = spelled(unit)
    return known.get(key) or known.get(_SPELLINGS.get(key, key))


def read_unit(node: Node, what: str, table: Mapping[str, float], faults: FaultList) -> str | None:
    """The unit that a node names; records a fault and returns None where it is not in ``table``."""
    if not isinstance(node, Scalar) or node.is_null:
        faults.error(node, f"{what} is {describe(node)}, not a unit", f"allowed are {', '.join(table)}")
        return None
    name = find(node.text, table)
    if name is None:
        hint = f"{did_you_mean(node.text, table)} allowed are {', '.join(table)}".strip()
        faults.error(node, f"{what} has the unit '{node.text.strip()}'", hint)
    return name


def read_quantity(node: Node, what: str, table: Mapping[str, float], bare: str, faults: FaultList) -> float | None:
    """A number or expression such as ``-pi/2`` or ``0.36 deg``, in SI; a bare one is in ``bare``."""
    from rrrgen.yamltext.expressions import ExpressionError, parse_expression

    if not isinstance(node, Scalar) or node.is_null:
        faults.error(node, f"{what} is {describe(node)}, not a value", f"a number in {bare}, or with a unit")
        return None
    text, factor = node.text, table.get(bare, 1.0)
    for match in re.finditer(r"(?<=[\s\d.)])(?=[A-Za-z%°µμ])", text):
        name = find(text[match.start() :], table)
        if name is not None:
            text, factor = text[: match.start()], table[name]
            break
    try:
        value = float(parse_expression(text, units=False).expr) * factor
    except ExpressionError as error:
        faults.error(node, f"{what}: {error.message}", f"units are {', '.join(table)}", error.offset)
        return None
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not math.isfinite(value):
        faults.error(node, f"{what} is not a finite number")
        return None
    return value
