"""Units of recorded signals, each table mapping a unit to its factor to SI and radians."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from rrrgen.base.yamltext.document import FaultList, Node, ScalarNode, describe
from rrrgen.base.yamltext.suggestions import did_you_mean

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

# a torque column may hold these instead of a torque; A and V need a torque constant, % needs the rated torque
DRIVE_SIGNALS = {"A": 1.0, "mA": 1e-3, "V": 1.0, "%": 0.01, "one": 1.0}
COUNTS = "counts"


def normalise_spelling(unit: str) -> str:
    """Normalise the spelling of a unit, without blanks and product signs: ``Nm``, ``N m`` and ``N·m`` become equal."""
    text = unit.strip().replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("²", "^2")
    return re.sub(r"[\s*·^]+", "", text.replace("**", "^"))


_SPELLINGS = {"degree": "deg", "degrees": "deg", "radian": "rad", "radians": "rad", "turn": "rev", "turns": "rev"}


def unit_name(unit: str, table: Mapping[str, float]) -> str | None:
    """The key of ``table`` that ``unit`` spells, blanks and product signs aside; None if there is none."""
    known = {normalise_spelling(name): name for name in table}
    key = normalise_spelling(unit)
    return known.get(key) or known.get(_SPELLINGS.get(key, key))


def read_unit(node: Node, what: str, table: Mapping[str, float], faults: FaultList) -> str | None:
    """The key of ``table`` that the node names; a fault and None if it names none."""
    if not isinstance(node, ScalarNode) or node.is_null:
        faults.error(node, f"{what} is {describe(node)}, not a unit", f"allowed are {', '.join(table)}")
        return None
    name = unit_name(node.text, table)
    if name is None:
        hint = f"{did_you_mean(node.text, table)} allowed are {', '.join(table)}".strip()
        faults.error(node, f"{what} has the unit '{node.text.strip()}'", hint)
    return name


def read_quantity(node: Node, what: str, table: Mapping[str, float], bare: str, faults: FaultList) -> float | None:
    """Read a number or expression such as ``-pi/2`` or ``0.36 deg`` and convert it to SI; a fault and None if invalid.

    ``table`` maps the allowed units to their factors; a value without a unit is in ``bare``; ``what`` names the value
    in messages.
    """
    from rrrgen.base.yamltext.expressions import ExpressionError, parse_expression

    if not isinstance(node, ScalarNode) or node.is_null:
        faults.error(node, f"{what} is {describe(node)}, not a value", f"a number in {bare}, or with a unit")
        return None
    text, factor = node.text, table.get(bare, 1.0)
    for match in re.finditer(r"(?<=[\s\d.)])(?=[A-Za-z%°µμ])", text):
        name = unit_name(text[match.start() :], table)
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


SAME_UNIT = 1e-6  # relative difference below which two conversion factors are the same


def unit_of_factor(table: Mapping[str, float], factor: float) -> str:
    """Name of the unit in ``table`` (name -> factor to SI) that has this ``factor``; "" if there is none."""
    return next((name for name, value in table.items() if math.isclose(value, factor, rel_tol=SAME_UNIT)), "")
