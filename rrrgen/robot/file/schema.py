"""JSON Schema (draft 7) of the robot file, generated from the key tables that the reader uses."""

from __future__ import annotations

from typing import Any

from rrrgen.base.yamltext.keys import Key
from rrrgen.robot.file.fields import MAX_JOINTS, SECTIONS
from rrrgen.robot.names import IDENTIFIER

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
        "properties": {key.name: {"description": key.meaning, **_value(key)} for key in table},
    }
    required = [key.name for key in table if key.required]
    return {**schema, "required": required} if required else schema


def _vector(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "minItems": 3, "maxItems": 3, "items": items}


def _value(key: Key) -> dict[str, Any]:
    expression = {"$ref": _EXPRESSION}
    match key.kind:
        case "text":
            return {"type": ["string", "null"]}
        case "name":
            return {"type": "string", "pattern": IDENTIFIER}
        case "choice":
            return {"enum": list(key.choices)}
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
