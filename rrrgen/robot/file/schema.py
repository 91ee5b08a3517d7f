"""JSON Schema (draft 7) of the robot file, generated from the key tables that the reader uses."""

from __future__ import annotations

from typing import Any

from rrrgen.base.yamltext.fields import Key
from rrrgen.base.yamltext.units import QUANTITIES
from rrrgen.robot.file.fields import MAX_JOINTS, SECTIONS
from rrrgen.robot.spec import IDENTIFIER

# ------------------------------------------------------------------------------------------------------------------
# The reference page of the robot file in Markdown, with every key, made from the key tables that the reader uses.
# ------------------------------------------------------------------------------------------------------------------

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
    "floating": "`floating_base`",
    "tip": "One of `tips`",
    "loop": "One of `loops`",
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
    "pair": "list of 2 names",
    "points": "name: list of 3",
    "displacements": "name: value",
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
    return f"| {name} | {_value_text(key)} | {_unit(key)} | {key.meaning.replace('|', chr(92) + '|')} |"


def _value_text(key: Key) -> str:
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
    if key.kind not in ("value", "vector", "points", "displacements"):
        return ""
    units = [QUANTITIES[key.quantity].si_unit]
    if key.prismatic:
        units.append(QUANTITIES[key.prismatic].si_unit)
    text = ", ".join(dict.fromkeys(f"`{unit}`" for unit in units if unit and unit != "one"))
    return f"{text}; bare: `units`" if key.file_units else text


# ------------------------------------------------------------------------------------------------------------------
# JSON Schema (draft 7) of the robot file, generated from the key tables that the reader uses
# ------------------------------------------------------------------------------------------------------------------

_EXPRESSION = "#/definitions/expression"


def json_schema() -> dict[str, Any]:
    """The JSON Schema of the robot file as a plain dictionary, for editors that complete and check YAML."""
    definitions = {name: _section(name) for name in SECTIONS if name != "robot"}
    definitions["expression"] = {
        "description": "a number or an expression over numbers, pi, parameters, + - * / **, sqrt, sin, cos, and a unit",
        "type": ["number", "string"],
    }
    definitions["joint"]["allOf"] = [
        {"if": {"properties": {"type": {"const": kind}}}, "then": {"required": [needed]}}
        for kind, needed in (("revolute", "d"), ("prismatic", "theta"))
    ]
    definitions["loop"]["oneOf"] = [{"required": names} for names in (["assembly"], ["solve", "start"])]
    matrices = ("joint_from_drive", "drive_from_joint")
    definitions["drives"]["oneOf"] = [{"required": [name]} for name in matrices]
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "rrrgen robot",
        **_section("robot"),
        "definitions": definitions,
    }


def _section(name: str) -> dict[str, Any]:
    table = SECTIONS[name]
    schema: dict[str, Any] = {
        "type": "object",
        "additionalProperties": False,
        "properties": {key.name: {"description": key.meaning, **_value_schema(key)} for key in table},
    }
    required = [key.name for key in table if key.required]
    return {**schema, "required": required} if required else schema


def _vector(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "minItems": 3, "maxItems": 3, "items": items}


def _value_schema(key: Key) -> dict[str, Any]:
    expression = {"$ref": _EXPRESSION}
    match key.kind:
        case "text":
            return {"type": ["string", "null"]}
        case "name":
            return {"type": "string", "pattern": IDENTIFIER}
        case "choice":
            numbers = [int(word) for word in key.choices if word.lstrip("+-").isdigit()]  # YAML reads them as such
            return {"enum": [*key.choices, *dict.fromkeys(numbers)]}
        case "choices":
            return {"type": "array", "uniqueItems": True, "items": {"enum": list(key.choices)}}
        case "value":
            return {"allOf": [expression]}
        case "vector":
            return _vector(expression)
        case "matrix":
            return _vector(_vector(expression))
        case "square":
            row = {"type": "array", "minItems": 1, "maxItems": MAX_JOINTS, "items": expression}
            return {**row, "items": row}
        case "mapping":
            # an empty value reads as an empty mapping
            section = {"$ref": f"#/definitions/{key.section}"}
            return {"allOf": [section]} if key.required else {"anyOf": [section, {"type": "null"}]}
        case "rows":
            items = {"$ref": f"#/definitions/{key.section}"}
            return {"type": "array", "minItems": 1, "maxItems": key.length, "items": items}
        case "transforms":
            section = {"$ref": f"#/definitions/{key.section}"}
            return {"type": "object", "propertyNames": {"pattern": IDENTIFIER}, "additionalProperties": section}
        case "names":
            return {"type": "object", "propertyNames": {"pattern": IDENTIFIER}, "additionalProperties": expression}
        case "pair":
            item = {"type": "string", "pattern": IDENTIFIER}
            return {"type": "array", "minItems": 2, "maxItems": 2, "uniqueItems": True, "items": item}
        case "points":
            points = {"propertyNames": {"pattern": IDENTIFIER}, "additionalProperties": _vector(expression)}
            return {"type": "object", "minProperties": 2, "maxProperties": 2, **points}
        case "displacements":
            values = {"propertyNames": {"pattern": IDENTIFIER}, "additionalProperties": expression}
            return {"type": "object", "minProperties": 2, "maxProperties": 2, **values}
        case "count":
            return {"type": "integer", "minimum": 0}
        case "texts":
            return {"type": "array", "minItems": 1, "items": {"type": "string"}}
        case "basis":
            entry = {"type": "object", "minProperties": 1, "maxProperties": 1, "additionalProperties": expression}
            entries = {"type": "array", "minItems": 1, "items": {"anyOf": [{"type": "string"}, entry]}}
            if key in SECTIONS["basis"]:
                return entries
            return {"anyOf": [entries, {"$ref": "#/definitions/basis"}]}
