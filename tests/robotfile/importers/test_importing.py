"""Choices of an import: wrong ones are refused, several tips are listed."""

from __future__ import annotations

import pytest

from robotfile.importers.urdf_files import ARM, write
from rrrgen.base.errors import InputError
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice

CHOICES = {
    "tip": (ChainChoice(tip="tol"), "the tip: there is no link 'tol'"),
    "base": (ChainChoice(base="bas"), "the base: there is no link 'bas'"),
    "hold": (ChainChoice(held={"lit": 0}), "there is no joint 'lit' to hold"),
    "nothing moves": (ChainChoice(tip="tool", base="lower"), "no joint moves between 'lower' and 'tool'"),
}


@pytest.mark.parametrize("case", CHOICES)
def test_a_wrong_choice_is_refused(case, tmp_path):
    choice, message = CHOICES[case]
    with pytest.raises(InputError, match=message):
        import_robot(write(tmp_path, ARM), chain=choice)


def test_several_tips_are_listed(tmp_path):
    more = '<link name="cup"/><joint name="c" type="fixed"><parent link="lower"/><child link="cup"/></joint></robot>'
    with pytest.raises(InputError, match=r"2 chains from 'base'(.|\n)*cup \(2 joints\), tool \(2 joints\)"):
        import_robot(write(tmp_path, ARM.replace("</robot>", more)))


def test_a_choice_of_a_chain_needs_a_tree(tmp_path):
    file = write(tmp_path, "dh_theta: [0]\n", "arm.yaml")
    with pytest.raises(InputError, match="ur-calibration is one chain already"):
        import_robot(file, chain=ChainChoice(tip="tool"))
