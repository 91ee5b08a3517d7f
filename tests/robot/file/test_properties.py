"""Whatever the bytes: a robot, or an InputError with a place inside the file. Nothing else, and nothing is executed."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.base.errors import InputError
from rrrgen.robot.file import RobotSpec, bundled_path, dumps, load_spec, loads_spec
from tests.robot.file.sample import SAMPLE

ROBOTS = [SAMPLE, *(bundled_path(name).read_text(encoding="utf-8") for name in ("rrr", "stanford", "panda"))]
TOKENS = [
    *("{", "}", "[", "]", ": ", "- ", "\n", "  ", "'", '"', "#", "&a ", "*a ", "|", ">-", "~", "null", "<<: ", "? "),
    *(
        "!!python/name:os.system ",
        "%YAML 1.1\n",
        "---\n",
        "\t",
        "\r",
        "\x00",
        "\u2028",
        "\xe9",
        "@",
        "`",
        "\\",
        "=",
        "-",
    ),
    *("pi", "0,35", "1e999", "9**9", "deg", "mm", ".nan", "q1", "m1", "alpha", "links:", "basis:"),
]


def outcome(text: str) -> RobotSpec | InputError:
    try:
        return loads_spec(text, "r.yaml")
    except InputError as error:
        return error


def check(text: str) -> None:
    read = outcome(text)
    if isinstance(read, RobotSpec):
        assert loads_spec(dumps(read)) == read
        return
    assert any(fault.severity == "error" for fault in read.faults)
    lines = 1 + sum(text.count(end) for end in ("\n", "\r", "\x85", "\u2028", "\u2029"))
    for fault in read.faults:
        assert fault.file == "r.yaml"
        assert 0 <= fault.line <= lines
        assert fault.column <= len(fault.source_line) + 1


@given(st.lists(st.tuples(st.floats(0, 1), st.integers(0, 4), st.sampled_from(TOKENS)), max_size=4))
def test_mutated_files(edits: list[tuple[float, int, str]]) -> None:
    text = SAMPLE
    for where, removed, inserted in edits:
        at = int(where * len(text))
        text = text[:at] + inserted + text[at + removed :]
    check(text)


@given(st.integers(0, 2**32))
def test_shuffled_lines_and_words(seed: int) -> None:
    generator = random.Random(seed)
    lines = generator.choice(ROBOTS).splitlines()
    for _ in range(3):
        i, j = generator.randrange(len(lines)), generator.randrange(len(lines))
        lines[i], lines[j] = generator.choice([(lines[j], lines[i]), (lines[j], lines[j]), ("", lines[i] + lines[j])])
    words = generator.choice(lines).split(" ")
    generator.shuffle(words)
    lines[generator.randrange(len(lines))] = " ".join(words)
    check("\n".join(lines))


@given(st.text(max_size=200))
def test_garbage_text(text: str) -> None:
    check(text)


@given(st.lists(st.sampled_from([*TOKENS, "a", "1", "schema: rrrgen/1\n", "joints:\n"]), max_size=40).map("".join))
def test_garbage_yaml(text: str) -> None:
    check(text)


@given(data=st.binary(max_size=200))
def test_garbage_bytes(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "garbage.yaml"
    path.write_bytes(data)
    with pytest.raises(InputError):
        load_spec(path)


FIELDS = [
    *("elbow3", "standard", "rad", "-9.81", "0.200", "q1", "revolute", "pi/2", "d1,", "9.2", "0.004", "com,", "0.21"),
    "{}",
]
CODE = [
    "__import__('os').system('touch {mark}')",
    "!!python/object/apply:os.system ['touch {mark}']",
    "!!python/object/new:subprocess.check_call [['touch', '{mark}']]",
    "open('{mark}', 'w')",
    "exec(open('{mark}', 'w'))",
    "{{{{ 1 }}}}",
    "${{IFS}}touch {mark}",
    "lambda: open('{mark}', 'w')",
]


@given(st.sampled_from(FIELDS), st.sampled_from(CODE), st.booleans())
def test_code_in_any_field_is_not_executed(field: str, code: str, quoted: bool) -> None:
    mark = Path.cwd() / "rrrgen_executed_a_robot_file"
    payload = code.format(mark=mark)
    text = SAMPLE.replace(field, '"' + payload.replace('"', "'") + '"' if quoted else payload, 1)
    assert isinstance(outcome(text), InputError)
    assert not mark.exists()
