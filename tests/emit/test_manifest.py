"""The manifest, and the hash that ties code to its robot."""

from __future__ import annotations

import json
import re

import jsonschema
import pytest

from emit.planar import planar_model, spec
from rrrgen.base.files import checksum
from rrrgen.emit.package import emit
from rrrgen.robot.identity import identify


@pytest.fixture(scope="module")
def files():
    return emit(planar_model())


def test_the_manifest_lists_what_was_emitted(files):
    content = json.loads(files["manifest.json"])
    assert content["robot"] == "planar"
    assert content["model_hash"] == identify(spec()).model_hash
    assert content["files"] == {name: checksum(data) for name, data in files.items() if name != "manifest.json"}
    assert {"planar.h", "planar.c", "planar_selftest.c", "CMakeLists.txt", "planar.pc"} <= set(content["files"])
    assert [p["name"] for p in content["base_parameters"]] == ["b1", "b2", "b3", "b4", "b5", "b6"]
    assert content["base_parameters"][0]["expression"] == "Izz1 + m2/4"
    function = content["functions"]["inverse_dynamics"]
    assert function["inputs"][0] == {"name": "q", "shape": [2], "unit": "rad", "frame": "joint"}
    assert function["outputs"][0]["shape"] == [2]
    assert function["operations"]["sincos"] == 3


def test_the_manifest_describes_the_inverse_kinematics(files):
    entry = json.loads(files["manifest.json"])["inverse_kinematics"]
    assert entry["solver"]
    assert (entry["family"], entry["task"], entry["max_solutions"]) == ("point", "position", 2)
    assert entry["branch"] == [{"name": "elbow", "bit": 0, "bits": 1}]
    assert set(entry["files"]) < set(files)
    assert all(f" {name}(" in files["planar_ik.h"].replace("*", " ") for name in entry["functions"])
    assert all(f'"{reason}"' in files["planar_ik.c"] for reason in entry["reasons"])
    assert f"{entry['operations']['mul']} mul, {entry['operations']['add']} add" in files["planar_ik.h"]
    assert f"(planar_ik_real){entry['tolerances']['accept']!r}" in files["planar_ik.c"]
    assert all(f"Stack: at most {size} bytes." in files["planar_ik.h"] for size in entry["stack"].values())


def test_every_source_states_the_model_that_it_is_of(files):
    model = identify(spec()).model_hash[:16]
    sources = {name for name in files if name.endswith(".c") and "selftest" not in name}
    assert {"planar.c", "planar_ik.c"} <= sources
    for name in sources:
        assert re.findall(r"from model (\w{16})", files[name]) == [model], name


def test_the_manifest_keeps_its_shape():
    text = emit(planar_model(links=False, drives=False))["manifest.json"]
    port = {"type": "object", "required": ["name", "shape", "unit", "frame"]}
    ports = {"type": "array", "items": port}
    function = {
        "type": "object",
        "required": ["inputs", "outputs", "operations", "stack"],
        "properties": {"inputs": ports, "outputs": ports},
    }
    required = (
        "schema robot model_hash tool convention units real n b joints gravity base_parameters regrouping functions "
        "inverse_kinematics"
    )
    schema = {
        "type": "object",
        "required": [*required.split(), "passes", "files"],
        "properties": {
            "schema": {"const": "rrrgen-manifest/1"},
            "functions": {"type": "object", "additionalProperties": function},
            "base_parameters": {"type": "array", "items": {"properties": {"nominal": {"type": "null"}}}},
            "files": {"type": "object", "additionalProperties": {"type": "string", "pattern": "^[0-9a-f]{64}$"}},
        },
    }
    jsonschema.validate(json.loads(text), schema)


def test_no_file_tells_a_date_a_path_or_a_host(files):
    text = "".join(data for data in files.values() if isinstance(data, str))
    assert not re.search(r"20\d\d-\d\d-\d\d|\d\d:\d\d:\d\d|/home/|/tmp/|/root/|C:\\", text)


def test_every_line_ends_as_it_should(files):
    for name, data in files.items():
        assert "\r" not in data, name
        assert data.endswith("\n"), name
        assert not re.search(r"[ \t]\n", data), f"{name} has blanks at the end of a line"
