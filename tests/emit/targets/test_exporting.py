"""Exporting: what cannot be done is refused, packages have the modes and parts chosen, suffixes name files."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace

import pytest
from click.testing import CliRunner

from emit.targets.compared import names_of
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import cli
from rrrgen.derive import derive_model
from rrrgen.exporting import export_robot, exporters
from rrrgen.robot.file import load_spec


def test_what_cannot_be_done_is_refused(tmp_path):
    bare = replace(load_spec("rrr"), links=None)
    with pytest.raises(DerivationError, match="has no links"):
        export_robot(bare, "mjcf")
    with pytest.raises(InputError, match="no value for the base parameters"):
        export_robot(bare, "mjcf", {})
    with pytest.raises(InputError, match="'Izz9R' is no base parameter"):
        export_robot(bare, "urdf", {"Izz9R": 1.0})
    with pytest.raises(DerivationError, match="no rigid bodies"):
        export_robot(bare, "mjcf", dict.fromkeys(names_of(derive_model(bare, ())), -1.0))
    with pytest.raises(InputError, match="there is no target 'urf'; did you mean 'urdf'"):
        export_robot(bare, "urf")
    assert exporters().keys() >= {"urdf", "mjcf", "par"}


def test_a_package_has_the_modes_and_parts_that_were_chosen(tmp_path):
    """Also where `generate` writes it; contradictions are refused."""
    words = ["pendulum", "--with", "controller", "--modes", "computed_torque", "--parts", "none"]
    done = CliRunner().invoke(cli, ["export", *words, "--to", "embedded", "-o", str(tmp_path / "a")])
    assert done.exit_code == 0, done.output
    header = (tmp_path / "a" / "src" / "pendulum_controller.h").read_text(encoding="utf-8")
    assert re.search(r"Modes *free, gravity, computed_torque\n.*Parts *none", header)
    with_target = ["generate", *words, "--with", "embedded", "--rate", "500", "--no-casadi-files", "-j", "1"]
    done = CliRunner().invoke(cli, [*with_target, "-o", str(tmp_path / "b")])
    assert done.exit_code == 0, done.output
    own, packed = (
        tmp_path / "b" / "pendulum_controller.c",
        tmp_path / "b" / "embedded" / "src" / "pendulum_controller.c",
    )
    assert own.read_bytes() == packed.read_bytes()
    sample = tmp_path / "b" / "embedded" / "zephyr" / "samples" / "controller" / "src" / "main.c"
    assert "#define PERIOD_US 2000" in sample.read_text(encoding="utf-8")
    for wrong, said in (
        (["--to", "embedded", "--parts", "none,observer"], "leaves all parts out"),
        (["--to", "embedded", "--parts", "obsever"], "did you mean"),
        (["--to", "urdf", "--modes", "gravity"], "belong to --with controller"),
        (["--to", "embedded", "--with", "controller", "--parts", "estimator"], "accelerations"),
    ):
        refused = CliRunner().invoke(cli, ["export", "pendulum", *wrong, "-o", str(tmp_path / "c")])
        assert refused.exit_code != 0, wrong
        assert said in refused.output + str(refused.exception), wrong


def test_packages_named_by_their_suffix_are_files(tmp_path, monkeypatch):
    """`-o x.fmu` used to make a folder; the name of a wheel says its platform, so that another name is refused."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, ["export", "pendulum", "--to", "fmu", "-o", "x.fmu"])
    assert done.exit_code == 0, done.output
    assert "modelDescription.xml" in zipfile.ZipFile("x.fmu").namelist()
    again = CliRunner().invoke(cli, ["export", "pendulum", "--to", "fmu", "-o", "x.fmu"])
    assert "the file exists already" in str(again.exception)
    CliRunner().invoke(cli, ["export", "pendulum", "--to", "fmu", "-o", "folder"])
    assert {path.name for path in (tmp_path / "folder").iterdir()} == {"pendulum.fmu", "README.md"}
    wheel = CliRunner().invoke(cli, ["export", "pendulum", "--to", "wheel", "-o", "x.whl"])
    assert isinstance(wheel.exception, InputError)
    assert "pendulum_model-" in str(wheel.exception)
    assert not (tmp_path / "x.whl").exists()


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_a_folder_in_the_place_of_a_file_is_called_one(tmp_path, force):
    refused = CliRunner().invoke(cli, ["export", "pendulum", "--to", "urdf", "-o", str(tmp_path), *force])
    assert isinstance(refused.exception, InputError)
    assert "a folder has this name" in str(refused.exception)
    assert str(tmp_path / "pendulum.urdf") in str(refused.exception)
