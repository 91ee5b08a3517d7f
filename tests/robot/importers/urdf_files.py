"""A URDF written for a test, and what its import says."""

from __future__ import annotations

from pathlib import Path

AGREE = 1e-9  # relative; both sides compute with doubles, and a frame may lie some ten metres away
ARM = """\
<robot name="two link">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial><visual/></link>
  <link name="lower"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  <link name="tool"><inertial><mass value="1"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="revolute"><origin xyz="0 0 0.3" rpy="1.5708 0 0"/>
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="0" velocity="1.5"/><dynamics damping="0.4" friction="0"/></joint>
  <joint name="fore-arm" type="continuous"><origin xyz="0.5 0 0"/>
    <parent link="upper"/><child link="lower"/><axis xyz="0 0 -1"/></joint>
  <joint name="flange" type="fixed"><origin xyz="0.2 0 0"/><parent link="lower"/><child link="tool"/></joint>
  <transmission name="t"><joint name="lift"/><actuator name="m"><mechanicalReduction>50</mechanicalReduction>
    </actuator></transmission>
</robot>
"""


def write(folder: Path, text: str, name: str = "arm.urdf") -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def said(found) -> str:
    return "\n".join(str(note) for note in found.notes)
