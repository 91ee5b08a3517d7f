"""The reference page, in Markdown, of the files that accompany an experiment, made from the tables of their readers."""

from __future__ import annotations

from collections.abc import Iterator

from rrrgen.base.yamltext.fields import Entries, Entry
from rrrgen.lab.closed_loop import controller
from rrrgen.lab.data import mapping, preprocessing
from rrrgen.lab.experiment.experiment_file import KEYS as EXPERIMENT
from rrrgen.lab.response import response_file

_INTRODUCTION = """\
# Every key of the other files

This page is printed by `rrrgen schema --other-files` from the tables that the readers use. A robot file has
[a page of its own](robot-file.md).

Values may have a unit, `350 mm`, `20 Hz`, `0.05 N*m`; bare numbers are in the units of the last column. Values per
joint are a list, or one number for all joints. Unknown keys are refused, with file, line and column and the keys
allowed. Required keys are **bold**.
"""
_MAPPING = """\
## Mapping file of a recording

For `--log`; examples stand in [Identify your own arm](identification.md).
"""
_EXPERIMENT = """\
## Experiment file

For `--experiment` of `excite` and `simulate`; `response-model` takes elastic parts and postures from it.
"""
_CONTROLLER = """\
## Controller file

For `--controller` of `identify`, `validate` and `friction`: the discrete controller exactly as it is implemented.
"""
_RESPONSE = """\
## Response file

For `frf`: recordings of one excited loop or joint.
"""
_TABLES = """\
## Tables

[Calibration](calibration.md) takes measurements as CSV, with names and units of the columns in the header.
"""
_PARTS_OF_EXPERIMENT = {
    "excitation": "`excitation`",
    "limits": "`limits` of `excitation`",
    "box": "`box` of these limits",
    "writing": "`writing`",
    "plane": "`plane` of `writing`",
    "virtual_robot": "`virtual_robot`",
    "friction": "`friction` of `virtual_robot`",
    "flexible_joints": "`flexible_joints` of `virtual_robot`",
    "flexible_base": "`flexible_base` of `virtual_robot`",
    "control": "`control`",
    "response": "`response`",
}


def reference_page() -> str:
    """The page: a section per file format, with a table for each of its mappings."""
    return "\n".join((_INTRODUCTION, *_mapping(), *_experiment(), *_controller(), *_response(), _TABLES))


def _mapping() -> Iterator[str]:
    yield _MAPPING
    keys = mapping.KEYS
    yield _table("", keys["mapping"])
    yield _table("One of several `files`", mapping.FILE_KEYS)
    yield _table("`time`: a rate, a period, or recorded times", mapping.TIME_KEYS)
    yield _table("A row of `joints`", keys["joint"])
    yield _table("`base`: columns in SI", keys["base"])
    yield _table("A channel: value = sign * (column - zero) * factor", keys["channel"])
    yield _table("`processing`; what is missing is chosen from the bandwidth of the motion", preprocessing.KEYS)


def _experiment() -> Iterator[str]:
    yield _EXPERIMENT
    yield _table("", EXPERIMENT["experiment"])
    for section, title in _PARTS_OF_EXPERIMENT.items():
        yield _table(title, EXPERIMENT[section])


def _controller() -> Iterator[str]:
    yield _CONTROLLER
    yield _table("", controller.KEYS)
    yield _table("A row of `joints`; keys that are missing are those of all joints", controller.JOINT_KEYS)
    rows = [
        _row(f"{_name(key, entry)} of `{operation}`" if key != operation else _name(key, entry), entry)
        for operation, keys in controller.OPERATIONS.items()
        for key, entry in keys.items()
    ]
    yield _lines("An operation of `signals`", rows)


def _response() -> Iterator[str]:
    yield _RESPONSE
    yield _table("", response_file.KEYS)
    yield _table("`time`: a rate, a period, or recorded times", mapping.TIME_KEYS)
    yield _table("`excitation`, `input`, `output`", response_file.CHANNEL_KEYS)
    yield _table("`controller`, whose output is subtracted from the excitation", response_file.CONTROLLER_KEYS)


def _table(title: str, table: Entries) -> str:
    return _lines(title, [_row(_name(key, entry), entry) for key, entry in table.items()])


def _lines(title: str, rows: list[str]) -> str:
    heading = [f"### {title}", ""] if title else []
    return "\n".join((*heading, "| key | value | unit |", "|---|---|---|", *rows, ""))


def _name(key: str, entry: Entry) -> str:
    return f"**`{key}`**" if entry.required else f"`{key}`"


def _row(name: str, entry: Entry) -> str:
    return f"| {name} | {entry.meaning} | {entry.unit} |"
