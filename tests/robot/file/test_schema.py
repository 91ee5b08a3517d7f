"""The JSON Schema accepts what the reader accepts, and rejects misspelt keys before the reader sees them."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from ruamel.yaml import YAML

from rrrgen.robot.file import bundled_names, bundled_path, dumps, json_schema, load_spec
from tests.robot.file.sample import SAMPLE

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")


def valid(data: Any) -> bool:
    return bool(jsonschema.Draft7Validator(json_schema()).is_valid(data))


def read(text: str) -> Any:
    return json.loads(json.dumps(YAML(typ="safe", pure=True).load(text)))


def test_schema_is_a_schema() -> None:
    jsonschema.Draft7Validator.check_schema(json_schema())
    assert json.loads(json.dumps(json_schema())) == json_schema()


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_robots_are_valid(name: str) -> None:
    assert valid(read(bundled_path(name).read_text(encoding="utf-8")))
    assert valid(read(dumps(load_spec(name))))


def test_sample_is_valid() -> None:
    assert valid(read(SAMPLE))
    assert valid(read(SAMPLE.replace("tool: {}", "tool:")))


SPOILT = {
    "misspelt key": ("alpha: pi/2", "alhpa: pi/2"),
    "misspelt section": ("links:", "linsk:"),
    "missing convention": ("convention: standard\n", ""),
    "missing unit": (", length: m}", "}"),
    "missing d": ("d: d1, ", ""),
    "missing theta": ("d: 0, theta: 0}\nlinks", "d: 0}\nlinks"),
    "wrong choice": ("standard", "modifed"),
    "wrong schema": ("rrrgen/1", "rrrgen/2"),
    "short vector": ("[0, 0, -9.81]", "[0, -9.81]"),
    "not an identifier": ("elbow3", "elbow-3"),
    "list as number": ("a2: 0.200", "a2: [1]"),
    "boolean": ("a2: 0.200", "a2: true"),
    "missing about": ("about: com, xx: 0.1,", "xx: 0.1,"),
    "empty basis": ("tool: {}", "basis: []"),
    "basis with two names": ("tool: {}", "basis: [{p: m1, r: m2}]"),
    "basis without products": ("tool: {}", "basis: {parameters: [m1]}"),
}


@pytest.mark.parametrize("case", SPOILT)
def test_spoilt_files_are_rejected(case: str) -> None:
    old, new = SPOILT[case]
    assert old in SAMPLE
    assert not valid(read(SAMPLE.replace(old, new, 1)))


def test_every_key_is_described() -> None:
    def walk(schema: Any) -> None:
        for key, value in schema.get("properties", {}).items():
            assert value["description"], key
        for definition in schema.get("definitions", {}).values():
            walk(definition)

    walk(copy.deepcopy(json_schema()))
