"""Every kind of bad input: the place, what is wrong, and what is allowed."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from rrrgen.base.errors import InputError
from rrrgen.robot.file import load_spec, loads_spec
from tests.robot.file.sample import SAMPLE, spoil

# old text, new text, place of the fault, part of its message, part of its hint
ERRORS = {
    "unknown key": ("tool: {}", "limits: {}", "13:1", "unknown key 'limits' in the robot", "allowed are schema, name"),
    "misspelt key": ("alpha: pi/2", "alhpa: pi/2", "8:32", "unknown key 'alhpa'", "did you mean 'alpha'?"),
    "key of another format": ("theta: 0}\n  -", "offset: 0}\n  -", "8:58", "unknown key 'offset'", "mean 'theta'?"),
    "duplicate key": ("name: elbow3", "name: elbow3\nname: b", "3:1", "duplicate key 'name'", "first given at line 2"),
    "half of a character": (
        "name: elbow3",
        'name: elbow3\ndescription: "\\ud83e"',
        "3:14",
        "\\ud83e is half of a character",
        "write the character itself",
    ),
    "duplicate parameter": ("a2: 0.200", "a2: 1, a2: 2", "6:21", "duplicate key 'a2'", "line 6"),
    "missing convention": ("convention: standard\n", "", "1:1", "needs the key 'convention'", "standard | modified"),
    "missing units": ("units: {angle: rad, length: m}\n", "", "1:1", "needs the key 'units'", "angle: rad | deg"),
    "missing unit of length": (", length: m}", "}", "4:8", "units needs the key 'length'", "m | mm"),
    "missing about": ("about: com, xx: 0.1,", "xx: 0.1,", "12:40", "needs the key 'about'", "com | origin"),
    "missing d": ("d: d1, ", "", "8:5", "joint 1 needs the key 'd'", "constant of a revolute joint"),
    "missing theta": ("d: 0, theta: 0}\nlinks", "d: 0}\nlinks", "9:5", "needs the key 'theta'", "prismatic joint"),
    "wrong choice": ("convention: standard", "convention: modifed", "3:13", "'modifed' is not", "'modified'?"),
    "wrong schema": ("rrrgen/1", "rrrgen/2", "1:9", "'rrrgen/2' is not allowed", "allowed is rrrgen/1"),
    "number as mapping": ("tool: {}", "tool: 3", "13:7", "tool is '3', not a mapping", "{key: value, ...}"),
    "list as number": ("a2: 0.200", "a2: [1]", "6:18", "parameter a2 is a list, not a value", "a number"),
    "number as list": ("[0, 0, -9.81]", "-9.81", "5:10", "gravity is '-9.81', not a list", "[..., ..., ...]"),
    "list as name": ("name: elbow3", "name: [a]", "2:7", "name is a list, not a word", "letters"),
    "list as joint": ("  - {type: prismatic", "  - [1]\n  - {type: prismatic", "9:5", "a list, not a map", ""),
    "list as key": ("tool: {}", "? [1]\n: 2", "13:3", "a list as a key", "plain words"),
    "no value": ("gravity: [0, 0, -9.81]", "gravity:", "5:1", "'gravity' has no value", "acceleration of gravity"),
    "too short": ("[0, 0, -9.81]", "[0, -9.81]", "5:10", "gravity has 2 values instead of 3", "takes 3 values"),
    "too long": ("[0, 0, -9.81]", "[0, 0, -9,81]", "5:10", "4 values instead of 3", "decimal comma?"),
    "decimal comma in a block": ("  - {type: prismatic, alpha: 0, a: a2,", "  - {type: prismatic, alpha: 0, a: '0,35',",
                                 "9:38", "a comma inside a number", "decimal comma? write 0.35"),
    "decimal comma in a flow": ("a: a2", "a: 0,35", "9:38", "unknown key '35'", "decimal comma?"),
    "degrees in a rad file": ("alpha: pi/2", "alpha: 90", "8:39", "alpha of joint 1 is 90 rad", "write 90 deg"),
    "degrees in rpy": ("tool: {}", "tool: {rpy: [0, 0, 90]}", "13:20", "entry 3 of rpy of tool is 90", "90 deg"),
    "millimetres in an m file": ("a: a2", "a: 425", "9:36", "a of joint 2 is 425 m", "write 425 mm"),
    "millimetres per second squared": ("-9.81", "-9810", "5:10", "gravity is 9810 m/s^2", "m/s^2"),
    "a length as an angle": ("alpha: pi/2", "alpha: 90 mm", "8:39", "mm measures a length", "rad, mrad, deg"),
    "an angle as a length": ("d: d1", "d: 20 deg", "8:54", "deg measures an angle", "m, cm, mm"),
    "unknown unit": ("alpha: pi/2", "alpha: 90 degres", "8:42", "unknown unit 'degres'", "did you mean 'deg'?"),
    "unit behind a sum": ("a: a2", "a: 1 - 2 mm", "9:42", "stands behind a sum", "write (1 - 2) mm"),
    "unit behind a parameter": ("a: a2", "a: 2*a2 mm", "9:41", "behind the parameter 'a2'", "as a parameter too"),
    "unknown parameter": ("a: a2", "a: a3", "9:36", "unknown name 'a3'", "parameters: a2, d1"),
    "misspelt parameter": ("a: a2", "a: 1 + A2", "9:40", "unknown name 'A2'", "did you mean 'a2'?"),
    "later parameter": ("a2: 0.200", "a2: 2*d1", "6:20", "unknown name 'd1'", "declared further down"),
    "keyword of C as robot": ("elbow3", "while", "2:7", "a keyword of C or C++", "while_1"),
    "keyword of C++ as robot": ("elbow3", "template", "2:7", "a keyword of C or C++", ""),
    "keyword of Python as parameter": ("a2: 0.200", "lambda: 1", "6:14", "a keyword of Python", ""),
    "keyword of C as joint": ("name: q1", "name: int", "8:12", "joint name 'int' is a keyword of C", ""),
    "joint called like nothing": ("name: q1", 'name: "null"', "8:13", "'null' stands for no value", ""),
    "underscores in a row as robot": ("elbow3", "my__arm", "2:7", "two underscores in a row", "e.g. my_arm"),
    "underscore at the end of robot": ("elbow3", "elbow3_", "2:7", "two underscores in a row", "e.g. elbow3"),
    "header as robot": ("elbow3", "math", "2:7", "taken by a C header", "math_robot"),
    "CasADi as robot": ("elbow3", "casadi_arm", "2:7", "reserved by CasADi", ""),
    "link symbol as parameter": ("a2: 0.200", "m1: 0.200", "6:14", "parameter name 'm1' is reserved", "link symbols"),
    "C function as parameter": ("a2: 0.200", "exp: 0.200", "6:14", "'exp' is reserved", ""),
    "no identifier": ("elbow3", "elbow-3", "2:7", "not an identifier", "e.g. elbow_3"),
    "number as name": ("elbow3", "3", "2:7", "not an identifier", "beginning with a letter"),
    "unicode name": ("elbow3", "größe", "2:7", "not an identifier", ""),
    "long name": ("elbow3", "e" * 41, "2:7", "is too long", "at most 40"),
    "code": ("a2: 0.200", "a2: __import__('os').system('true')", "6:29", 'the character "\'" is not allowed', ""),
    "attribute": ("a: a2", "a: a2.real", "9:36", "not an arithmetic expression", "allowed are numbers"),
    "subscript": ("a: a2", 'a: "a2[0]"', "9:39", "the character '[' is not", "allowed are"),
    "unknown function": ("a: a2", "a: tan(1)", "9:36", "unknown function 'tan'", "sqrt, sin, cos"),
    "huge power": ("a2: 0.200", "a2: 9**9**9", "6:21", "this power is not allowed", "-16 to 16"),
    "nested powers": ("a2: 0.200", "a2: ((2**16)**16)**16", "6:19", "the powers are too high", "degree 64"),
    "huge exponent": ("a2: 0.200", "a2: 1e999", "6:18", "out of range", "1e330"),
    "caret as power": ("a: a2", "a: a2^2", "9:38", "'^' is not allowed", "**"),
    "implicit product": ("alpha: pi/2", "alpha: 2pi", "8:40", "an operator is missing", "2*pi"),
    "not a number": ("a2: 0.200", "a2: .nan", "6:18", "not a finite number", "finite"),
    "infinite": ("a2: 0.200", "a2: -.inf", "6:18", "not a finite number", "finite"),
    "boolean": ("a2: 0.200", "a2: true", "6:18", "unknown name 'true'", ""),
    "division by zero": ("a: a2", "a: 1/(a2 - a2)", "9:36", "division by zero", ""),
    "division by zero at the nominal values": ("a: a2", "a: 1/(d1 - 0.56)", "9:36", "not finite at the nominal", ""),
    "imaginary at the nominal values": ("a: a2", "a: sqrt(a2 - d1)", "9:36", "not real at the nominal", "root"),
    "hexadecimal": ("a2: 0.200", "a2: 0x10", "6:19", "an operator is missing", ""),
    "leading zero": ("a2: 0.200", "a2: 010", "6:18", "not an expression", "no leading zero"),
    "open parenthesis": ("a: a2", "a: (a2", "9:36", "not an expression", "allowed are"),
    "negative mass": ("mass: 3", "mass: -3", "12:12", "mass of link 2 is negative", ""),
    "huge mass": ("mass: 3", "mass: 1e16", "12:12", "mass of link 2 is 1e+16", "at most 1e+15"),
    "device as robot": ("elbow3", "CON", "2:7", "a device of Windows", "CON_robot"),
    "digits of another script": ("a2: 0.200", "a2: ٣", "6:18", "the character '٣' is not allowed", ""),
    "irrational mass": ("mass: 3", "mass: pi", "12:12", "mass of link 2 is not a rational number", "decimal"),
    "reflection": ("tool: {}", "tool: {rotation: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}", "13:18", "a reflection", "+1"),
    "not orthonormal": ("tool: {}", "tool: {rotation: [[1, 0, 0], [0, 1, 0], [0, 0.1, 1]]}", "13:18",
                        "not orthonormal", "sqrt(2)/2"),
    "rpy and rotation": ("tool: {}", "tool: {rpy: [0, 0, 0], rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}", "13:34",
                         "both rpy and rotation", "one of them"),
    "fewer links than joints": (SAMPLE.splitlines()[11] + "\n", "", "11:3", "1 links for 2 joints", "all 2 links"),
    "no links": (SAMPLE[SAMPLE.index("links") : SAMPLE.index("tool")], "links: []\n", "10:8", "links is empty", ""),
    "no joints": (SAMPLE[SAMPLE.index("joints") : SAMPLE.index("links")], "joints: []\n", "7:9", "joints is empty", ""),
    "joint names": ("{type: prismatic", "{name: q1, type: prismatic", "9:5", "'q1' of joint 2 is not unique", ""),
    "default joint name": ("name: q1", "name: q2", "9:5", "'q2' of joint 2 is not unique", "q1, q2, ..."),
    "limits": ("theta: 0}\n  -", "theta: 0, limits: {lower: 1, upper: -1}}\n  -", "8:76", "1 is not below", "<"),
    "negative velocity": ("theta: 0}\n  -", "theta: 0, limits: {velocity: -1}}\n  -", "8:87", "is -1", "positive"),
    "gear ratio": ("theta: 0}\n  -", "theta: 0, drive: {gear_ratio: 0}}\n  -", "8:88", "is zero", ""),
    "negative friction": ("theta: 0}\n  -", "theta: 0, friction: {viscous: -1}}\n  -", "8:88", "is -1", "negative"),
    "torque in newton": ("theta: 0}\n  -", "theta: 0, limits: {torque: 5 N}}\n  -", "8:85", "a force", "N*m"),
    "variable as offset": ("theta: 0}\n  -", "theta: q1}\n  -", "8:65", "the joint variable itself", "write 0"),
    "tag": ("a2: 0.200", "a2: !!python/object/apply:os.system [ls]", "6:18", "the YAML tag", "plain value"),
    "alias without anchor": ("tool: {}", "tool: *x", "13:7", "the alias *x has no anchor", ""),
    "recursive alias": ("tool: {}", "tool: &x {rpy: *x}", "13:7", "rpy of tool is a mapping", ""),
    "merge key": ("tool: {}", "<<: {a: 1}", "13:1", "unknown key '<<'", "not supported"),
    "tab": ("tool: {}", "\ttool: {}", "13:1", "a tab in the indentation", "spaces"),
    "open bracket": ("tool: {}", "tool: {", "14:1", "not valid YAML", "brackets"),
    "two documents": ("tool: {}", "---\na: 1", "13:1", "a second YAML document", "one robot per file"),
    "control character": ("tool: {}", "tool: \x07{}", "13:7", "U+0007", "plain UTF-8"),
    "basis: unknown link": ("tool: {}", "basis: [m1, p = m2 + Izz3]", "13:22", "unknown name 'Izz3'", "'Izz"),
    "basis: name": ("tool: {}", "basis: [3 = m1]", "13:9", "'3' is not an identifier", ""),
    "basis: standard name": (
        "tool: {}", "basis: [Izz1 = Izz1]", "13:9", "'Izz1' is that of a standard parameter", "Izz1R",
    ),
    "basis: name of a parameter": (
        "tool: {}", "basis: [a2 = Izz1]", "13:9", "'a2' is that of a named parameter", "another name",
    ),
    "basis: names": ("tool: {}", "basis: [p2 = m1, m2]", "13:18", "'p2' is not unique", ""),
    "basis: two entries": ("tool: {}", "basis: [{p: m1, r: m2}]", "13:9", "not one entry", "{p1: expression}"),
    "basis: empty": ("tool: {}", "basis: []", "13:8", "basis is an empty list", "Izz1"),
    "basis: products": ("tool: {}", "basis: {products: plus, parameters: [m1]}", "13:19", "'plus'", "tensor, positive"),
    "basis: ambiguous products": (
        "about: com, xx: 0.1, yy: 0.1, zz: 0.1}}\ntool: {}",
        "about: com, products: positive, xx: 0.1, yy: 0.1, zz: 0.1}}\nbasis: [Ixy1]",
        "13:8", "the links differ", "{products: tensor | positive",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ERRORS)
def test_fault_has_place_message_and_hint(case: str) -> None:
    old, new, place, message, hint = ERRORS[case]
    with pytest.raises(InputError) as caught:
        loads_spec(spoil(old, new), "r.yaml")
    assert caught.value.exit_code == 3
    found = [f for f in caught.value.faults if f"{f.line}:{f.column}" == place and message in f.message]
    assert found, f"expected r.yaml:{place}: {message}\n{caught.value}"
    assert hint in found[0].hint
    assert found[0].source_line == spoil(old, new).split("\n")[found[0].line - 1]
    assert str(found[0]).startswith(f"r.yaml:{place}: error: ")


WARNINGS = {
    "four digits of pi/2": ("alpha: pi/2", "alpha: 1.5708", "8:39", "which is pi/2 only to 4e-06 rad", "write pi/2"),
    "six digits of pi/2": ("alpha: pi/2", "alpha: -1.570796", "8:39", "which is -pi/2 only to 3e-07", "write -pi/2"),
    "two digits of pi/2": ("alpha: pi/2", "alpha: 1.57", "8:39", "only to 8e-04 rad", "write pi/2"),
    "five digits of pi": ("alpha: pi/2", "alpha: 3.14159", "8:39", "which is pi only to", "write pi"),
    "triangle inequality": ("zz: 0.1}", "zz: 0.5}", "12:40", "0.1, 0.1 and 0.5, break the triangle", "sum of any two"),
    "massless": ("mass: 3", "mass: 0", "12:40", "it has no mass", ""),
    "negative moment": ("zz: 0.1}", "zz: -0.1}", "12:40", "no rigid body has the inertia of link 2", ""),
    "products too large": ("xy: 0.002", "xy: 0.2", "11:54", "no rigid body has the inertia of link 1", ""),
    "inertia about the other point": ("about: com, xx: 0.21", "about: origin, xx: 0.21", "11:54", "no rigid body",
                                      "with 'about: com' it would be physical"),
    "reaction of gravity": ("-9.81", "9.81", "5:10", "gravity points along +z", "not its reaction"),
    "decimal comma within three entries": ("[0.004, -0.18, 0.012]", "[0, -0,18]", "11:29", "contains -0,18",
                                           "decimal comma? write -0.18"),
}  # fmt: skip


@pytest.mark.parametrize("case", WARNINGS)
def test_warning_is_kept_in_the_spec(case: str) -> None:
    old, new, place, message, hint = WARNINGS[case]
    faults = loads_spec(spoil(old, new), "r.yaml").faults
    found = [f for f in faults if f"{f.line}:{f.column}" == place and message in f.message]
    assert found, f"expected r.yaml:{place}: {message}\n" + "\n".join(map(str, faults))
    assert found[0].severity == "warning"
    assert hint in found[0].hint


@pytest.mark.parametrize(("bare", "unit"), [("3", ""), ("0.5", ""), ("3", " deg/s"), ("180", "")])
def test_slow_joints_in_the_units_of_the_file(bare: str, unit: str) -> None:
    """`velocity: 3` under `units: {angle: deg}` are 3 deg/s, which hardly anyone means; with a unit nothing is said."""
    text = SAMPLE.replace("angle: rad", "angle: deg").replace("alpha: pi/2", "alpha: 90")
    stated = text.replace("theta: 0}\n  -", f"theta: 0, limits: {{velocity: {bare}{unit}}}}}\n  -")
    said = [fault for fault in loads_spec(stated, "r.yaml").faults if "velocity" in fault.message]
    if unit or float(bare) > 10:
        assert not said
    else:
        assert f"velocity of joint 1 is {bare} deg/s" in said[0].message
        assert f"write {bare} rad/s, or {bare} deg/s" in said[0].hint


@pytest.mark.parametrize("bare", ["1.5704", "1.56", "0.7854", "1.58", "0.5", "pi/2", "0", "3/2"])
def test_other_angles_are_not_warned_about(bare: str) -> None:
    assert loads_spec(spoil("alpha: pi/2", f"alpha: {bare}")).faults == ()


def test_non_physical_inertia_is_an_error_when_strict() -> None:
    text = spoil("zz: 0.1}", "zz: 0.5}")
    assert len(loads_spec(text).faults) == 1
    with pytest.raises(InputError, match="triangle inequality"):
        loads_spec(text, strict=True)


def test_all_faults_at_once_as_they_are_printed() -> None:
    text = (
        SAMPLE.replace("standard", "modifed").replace("alpha: pi/2", "alpha: 90").replace("a: a2", "a: a3 + tan(1)")
    ).replace("mass: 3", "mss: 3")
    with pytest.raises(InputError) as caught:
        loads_spec(text, "bad.yaml")
    assert str(caught.value) == (Path(__file__).parent / "golden" / "bad.txt").read_text(encoding="utf-8").rstrip("\n")


def test_bytes_that_are_not_utf8(tmp_path: Path) -> None:
    file = tmp_path / "r.yaml"
    file.write_bytes(SAMPLE.encode().replace(b"elbow3", b"elbow3 # gr\xf6sse"))
    with pytest.raises(InputError, match=r"r\.yaml:2:18: error: the file is not UTF-8: byte 0xf6"):
        load_spec(file)
    file.write_bytes(SAMPLE.encode("utf-16"))
    with pytest.raises(InputError, match="not UTF-8 but UTF-16"):
        load_spec(file)


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "---\n", "~", "null\n"])
def test_empty_file(text: str) -> None:
    with pytest.raises(InputError):
        loads_spec(text)


@pytest.mark.parametrize("text", ["3", "[1, 2]", "robot", "- name: x"])
def test_file_that_is_no_mapping(text: str) -> None:
    with pytest.raises(InputError, match="not a mapping"):
        loads_spec(text)


def test_byte_order_mark_and_windows_line_ends_are_accepted(tmp_path: Path) -> None:
    file = tmp_path / "r.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + SAMPLE.replace("\n", "\r\n").encode())
    assert load_spec(file) == loads_spec(SAMPLE)


def test_tab_between_words_is_accepted() -> None:
    assert loads_spec(SAMPLE.replace("name: elbow3", "name:\telbow3\t# name")) == loads_spec(SAMPLE)


ROBUST = {
    "ten megabytes": ("a" * 10_000_000, "larger than 1 MB"),
    "aliases of aliases": (
        "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 40)) + "joints: *a39\n",
        "unknown key 'a0'",
    ),
    "many aliases": ("a: &x 1\nb: [" + "*x, " * 500 + "]\n", "too many aliases"),
    "many values": ("a: [" + "1, " * 300_000 + "]", "too many values"),
    "deep brackets": ("[ " * 400_000, "nested too deeply"),
    "deep mappings": ("{a: " * 200_000, "nested too deeply"),
    "long tag": ("!" * 900_000, "a word of more than"),
    "long word": ("name: " + "x" * 900_000, "a word of more than"),
    "deep parentheses": (spoil("a: a2", "a: " + "(" * 1000 + "1" + ")" * 1000), "too many nested parentheses"),
    "deep functions": (spoil("a: a2", "a: " + "sin(" * 45 + "a2" + ")" * 45), ""),
    "many signs": (spoil("a: a2", "a: " + "-" * 3000 + "1"), "is not an expression"),
    "long sum": (spoil("a: a2", "a: " + "+".join(["a2"] * 1200)), ""),
    "long value": (spoil("a: a2", "a: " + "1 + " * 1500 + "1"), "longer than 4000 characters"),
    "many joints": (SAMPLE.replace("links:", "  - {}\n" * 70 + "links:"), "at most 64"),
    "many faults": ("\n".join(f"k{i}: 1" for i in range(5000)), "unknown key 'k0'"),
}
LONGEST_SECONDS = 20  # measured below 2 s of processor time; room for a loaded machine


@pytest.mark.parametrize("case", ROBUST)
def test_bombs_are_refused_quickly(case: str) -> None:
    text, expected = ROBUST[case]
    start = time.process_time()
    shown = _fault_text(text)
    assert time.process_time() - start < LONGEST_SECONDS
    assert expected in shown if expected else not shown
    assert shown.count(": error: ") <= 100
    assert max((len(line) for line in shown.splitlines()), default=0) < 400


def _fault_text(text: str) -> str:
    try:
        loads_spec(text)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("name", ["rr", "", "a\0b.yaml", "x" * 5000, "missing.yaml", "./rrr", "/", "a" * 300 + ".yaml"])
def test_file_that_cannot_be_read(name: str) -> None:
    with pytest.raises(InputError):
        load_spec(name)


def test_misspelt_bundled_name() -> None:
    with pytest.raises(InputError, match="did you mean 'puma560'"):
        load_spec("puma56")


def test_file_larger_than_a_megabyte(tmp_path: Path) -> None:
    file = tmp_path / "big.yaml"
    file.write_bytes(b"#" * 10_000_000)
    with pytest.raises(InputError, match="larger than 1 MB"):
        load_spec(file)


def test_two_escapes_of_one_character_are_joined():
    text = SAMPLE.replace("name: elbow3", 'name: elbow3\ndescription: "an arm \\ud83e\\udd16"')
    assert loads_spec(text).description == "an arm \U0001f916"


def test_robots_read_from_the_same_text_share_nothing_that_can_be_changed() -> None:
    first = load_spec("rrr")
    for dictionary in (first.parameters, first.parameter_units, first.tools, first.tips):
        dictionary["changed"] = dictionary
    again = load_spec("rrr")
    assert not any("changed" in each for each in (again.parameters, again.parameter_units, again.tools, again.tips))
