"""The certificate: what it holds, that it is reproducible, and that tampering with any file is found."""

from __future__ import annotations

import json
import shutil

import click
import pytest
from click.testing import CliRunner

from rrrgen.base.errors import InputError
from rrrgen.cli.certify import certify
from rrrgen.evidence.certificate import CERTIFICATE, MARKDOWN, PAGE, VECTORS, content_digest
from rrrgen.evidence.check import bounds_that_differ
from rrrgen.robot.file import load_spec


def run(*arguments):
    done = CliRunner().invoke(certify, [str(argument) for argument in arguments], standalone_mode=False)
    if done.exception is not None:
        raise done.exception
    return done


@pytest.fixture(scope="module")
def certified(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certified") / "pendulum"
    assert run("pendulum", "-o", folder, "--samples", 20, "--no-casadi-files").return_value == 0
    return folder


@pytest.fixture
def copy(certified, tmp_path):
    return shutil.copytree(certified, tmp_path / "copy")


def content_of(folder):
    return json.loads((folder / CERTIFICATE).read_text(encoding="utf-8"))


def test_code_and_certificate_belong_together(certified):
    done = run("--check", certified)
    assert done.return_value == 0
    assert "code and certificate belong together" in done.output


def test_every_emitted_function_has_a_row(certified):
    content = content_of(certified)
    manifest = json.loads((certified / "manifest.json").read_text(encoding="utf-8"))
    assert set(manifest["functions"]) == set(content["functions"])
    for name, entry in content["functions"].items():
        rounding = entry["rounding"]
        if "none" in rounding:
            assert any(row["what"] == f"rounding of {name}" for row in content["skipped"])
            continue
        for precision in ("double", "float"):
            for port in manifest["functions"][name]["outputs"]:
                size = 1
                for extent in port["shape"]:
                    size *= extent
                assert len(rounding[precision]["bounds"][port["name"]]) == size


def test_sampled_errors_are_within_their_bounds(certified):
    for entry in content_of(certified)["functions"].values():
        for precision in ("double", "float"):
            if "none" not in entry["rounding"]:
                assert entry["rounding"][precision]["sampled"]["within"]


def test_the_equation_of_motion_is_traced_to_its_checks(certified):
    rows = {row["function"]: row for row in content_of(certified)["trace"]}
    assert rows["inverse_dynamics"]["equation"] == "(14.6)"
    assert "inverse_dynamics against Newton-Euler (built in)" in rows["inverse_dynamics"]["checks"]


def test_same_inputs_same_bytes(certified, tmp_path):
    run("pendulum", "-o", tmp_path / "again", "--samples", 20, "--no-casadi-files")
    for path in (CERTIFICATE, MARKDOWN, PAGE, VECTORS):
        assert (certified / path).read_bytes() == (tmp_path / "again" / path).read_bytes(), path


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


def test_again_proves_the_bounds_anew(copy):
    assert run("pendulum", "--check", copy, "--again").return_value == 0
    content = content_of(copy)
    content["functions"]["gravity"]["rounding"]["double"]["bounds"]["g"][0] *= 0.5
    assert bounds_that_differ(content, load_spec("pendulum")) == ["gravity: the bounds in double are others"]
    assert bounds_that_differ(content, load_spec("planar2r")) == [
        "planar2r: the robot file is not the one of the certificate"
    ]


def test_libm_has_no_bound(tmp_path):
    run("pendulum", "-o", tmp_path / "libm", "--samples", 5, "--trig", "libm", "--no-casadi-files")
    rounding = content_of(tmp_path / "libm")["functions"]["gravity"]["rounding"]
    assert "C library" in rounding["none"]


@pytest.mark.parametrize(
    "arguments", [(), ("pendulum",), ("--again",), ("pendulum", "-o", "x", "--check", ".")], ids=str
)
def test_contradictory_options_are_refused(arguments):
    with pytest.raises(click.UsageError):
        run(*arguments)


def test_a_folder_without_certificate_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=CERTIFICATE):
        run("--check", tmp_path)
