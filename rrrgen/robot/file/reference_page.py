"""The reference page of the robot file in Markdown, with every key, made from the key tables that the reader uses."""

from __future__ import annotations

from rrrgen.base.yamltext.keys import Key
from rrrgen.base.yamltext.units import QUANTITIES
from rrrgen.robot.file.fields import SECTIONS

_INTRODUCTION = """\
# Every key of a robot file

This page is printed by `rrrgen schema --markdown` from the tables that the reader uses; `rrrgen schema` prints the same
as JSON Schema, for editors.

Values are numbers or expressions over numbers, `pi`, the declared parameters, `+ - * / **`, `sqrt()`, `sin()`, `cos()`,
with at most one unit at the end: `90 deg`, `350 mm`, `a2/2`, `sqrt(2)/2`. A number without a unit is in SI units, or in
the units that the file declares where the table says so. Required keys are **bold**.
"""
_TITLES = {
    "robot": "The file",
    "units": "`units`",
    "joint": "One row of `joints`",
    "limits": "`limits` of a joint",
    "friction": "`friction` of a joint or a motor",
    "drive": "`drive` of a joint",
    "drives": "`drives`: coupled drives",
    "motor": "One row of `motors`",
    "link": "One row of `links`",
    "inertia": "`inertia` of a link",
    "transform": "`base` and `tool`",
    "basis": "`basis`",
    "fit": "One row of `provenance`",
}
_LINKED = {"mapping": "mapping", "rows": "list", "transforms": "name: mapping"}
_VALUES = {
    "text": "text",
    "name": "letters, digits, `_`",
    "vector": "list of 3",
    "matrix": "3 rows of 3",
    "square": "a row per joint",
    "names": "name: value",
    "basis": "list of expressions",
    "count": "whole number",
    "texts": "list of texts",
}


def reference_page() -> str:
    """The page: a table for each section, in the order of the schema."""
    parts = [_INTRODUCTION]
    for section, table in SECTIONS.items():
        lines = [f"## {_TITLES[section]}", "", "| key | value | unit | meaning |", "|---|---|---|---|"]
        lines += [_row(key) for key in table]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _row(key: Key) -> str:
    name = f"**`{key.name}`**" if key.required else f"`{key.name}`"
    return f"| {name} | {_value(key)} | {_unit(key)} | {key.meaning.replace('|', chr(92) + '|')} |"


def _value(key: Key) -> str:
    if key.kind in ("choice", "choices"):
        words = ", ".join(f"`{choice}`" for choice in key.choices)
        return words if key.kind == "choice" else f"list of {words}"
    if key.kind in ("mapping", "rows", "transforms"):
        title = _TITLES[key.section].lower()
        anchor = "".join(letter for letter in title if letter.isalnum() or letter in " _-").replace(" ", "-")
        return f"[{_LINKED[key.kind]}](#{anchor})"
    if key.kind == "value":
        return "value"
    return _VALUES[key.kind]


def _unit(key: Key) -> str:
    """The table cell with the SI units of a value (for both joint types), and whether ``units`` sets bare ones."""
    if key.kind not in ("value", "vector"):
        return ""
    units = [QUANTITIES[key.quantity].si_unit]
    if key.prismatic:
        units.append(QUANTITIES[key.prismatic].si_unit)
    text = ", ".join(dict.fromkeys(f"`{unit}`" for unit in units if unit and unit != "one"))
    return f"{text}; bare: `units`" if key.file_units else text
