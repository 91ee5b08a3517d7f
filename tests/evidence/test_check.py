"""The check of a certificate: every changed, missing and further file is found."""

from __future__ import annotations

import json
import shutil

import pytest
from click.testing import CliRunner

from evidence.certified import content_of, run
from rrrgen.base.errors import InputError
from rrrgen.cli.certify import certify
from rrrgen.evidence.certificate import CERTIFICATE, MARKDOWN, content_digest
from rrrgen.evidence.check import bounds_that_differ
from rrrgen.robot.file import load_spec


@pytest.fixture
def copy(certified, tmp_path):
    return shutil.copytree(certified, tmp_path / "copy")


def test_one_changed_byte_is_found_in_every_file(copy):
    """Each file in turn: the check names it and exits with 1."""
    for path in sorted(copy.rglob("*")):
        if path.is_dir():
            continue
        data = path.read_bytes()
        if not data:
            continue
        name = path.relative_to(copy).as_posix()
        middle = len(data) // 2
        path.write_bytes(data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :])
        done = CliRunner().invoke(certify, ["--check", str(copy)], standalone_mode=False)
        # the certificate itself may have become unreadable: then the error says which file
        assert done.return_value == 1 or isinstance(done.exception, InputError), name
        assert name in done.output + str(done.exception), name
        path.write_bytes(data)
    assert run("--check", copy).return_value == 0


def test_a_changed_space_of_the_certificate_is_found(copy):
    """The digest is of what the file says; how it says it is compared too."""
    place = copy / CERTIFICATE
    place.write_text(place.read_text(encoding="utf-8").replace("\n ", "\n\t", 1), encoding="utf-8", newline="\n")
    done = run("--check", copy)
    assert done.return_value == 1
    assert f"{CERTIFICATE}: is not as rrrgen writes it" in done.output


def test_a_bound_changed_with_its_digest_contradicts_the_pages(copy):
    """Whoever computes the digest anew must also write both pages anew: forgery, which only a signature finds."""
    content = content_of(copy)
    content["functions"]["gravity"]["rounding"]["double"]["worst"] = 1e-30
    content["digest"] = content_digest(content)
    (copy / CERTIFICATE).write_text(json.dumps(content), encoding="utf-8")
    done = run("--check", copy)
    assert done.return_value == 1
    assert MARKDOWN in done.output


def test_a_missing_and_a_further_file_are_found(copy):
    (copy / "pendulum.c").unlink()
    (copy / "other.c").write_text("int x;\n", encoding="utf-8")
    done = run("--check", copy)
    assert "pendulum.c: is missing" in done.output
    assert "other.c: is not in the certificate" in done.output


def test_the_robot_of_a_certificate_is_compared_if_one_is_given(copy):
    """The name of another robot was ignored, and its code said to belong to the certificate."""
    assert run("pendulum", "--check", copy).return_value == 0
    for again in ((), ("--again",)):
        done = run("rrr", "--check", copy, *again)
        assert done.return_value == 1
        assert "rrr: the robot file is not the one of the certificate" in done.output


def test_again_proves_the_bounds_anew(copy):
    assert run("pendulum", "--check", copy, "--again").return_value == 0
    content = content_of(copy)
    content["functions"]["gravity"]["rounding"]["double"]["bounds"]["g"][0] *= 0.5
    assert bounds_that_differ(content, load_spec("pendulum")) == ["gravity: the bounds in double are others"]
    content = content_of(copy)
    del content["functions"]["smooth_friction"]["rounding"]["assumption"]
    assert bounds_that_differ(content, load_spec("pendulum")) == ["smooth_friction: the bounds suppose something else"]
    content = content_of(copy) | {"templates": "0" * 64}
    assert bounds_that_differ(content, load_spec("pendulum")) == [
        "the templates of the C code are not those of this version of rrrgen"
    ]
