"""What a program says about itself: the function that it specializes."""

from rrrgen.derive import derive
from rrrgen.emit.c.robot_files import source_parts
from rrrgen.program import Program, specialization
from rrrgen.robot.file import load_spec


def program(name: str, specializes: str = "") -> Program:
    return Program(name, (), (), (), (), specializes=specializes)


def test_the_field_says_what_is_a_specialization_and_not_the_name():
    general, misleading, special = program("speed"), program("speed_nominal"), program("fast", "speed")
    assert [each.function for each in (general, misleading, special)] == ["speed", "speed_nominal", "speed"]
    assert specialization({"speed": general, "speed_nominal": misleading}, "speed") is None
    assert specialization({"speed": general, "fast": special}, "speed") is special
    derivatives = [program("speed_derivatives"), program("d", "speed_derivatives")]
    parts = source_parts([general, misleading, special, *derivatives])
    assert parts == {"": ["speed", "speed_nominal"], "_nominal": ["fast"], "_derivatives": ["speed_derivatives", "d"]}


def test_every_specialization_of_a_robot_names_its_function():
    programs = derive(load_spec("planar2r")).programs
    special = {name for name, each in programs.items() if each.specializes}
    assert special == {name for name in programs if name.endswith("_nominal")} != set()
    assert all(specialization(programs, programs[name].specializes) is programs[name] for name in special)
