"""Files of measurements: units, and faults at their place."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.calibrate.measurements import read_table

HEADER = "q1 [deg],q2,q3,x [mm],y [mm],z [mm]\n"


def test_files_in_other_units(tmp_path):
    file = tmp_path / "m.csv"
    file.write_text("# laser tracker\n" + HEADER + "90,0.1,0.2,100,200,300\n\n")
    found = read(file)
    np.testing.assert_allclose(found.q, [[np.pi / 2, 0.1, 0.2]])
    np.testing.assert_allclose(found.values, [[0.1, 0.2, 0.3]])
    half = np.sqrt(0.5)
    file.write_text(f"a,b,c,x,y,z,qw,qx,qy,qz\n0,0,0,1,2,3,{half},0,0,{half}\n")
    quaternion = read(file).values
    file.write_text("a,b,c,plane,height [mm]\n0,0,0,table,20\n0,0,1,wall,0\n1,0,0,table,0\n")
    planes = read(file)
    assert (planes.kind, planes.names, planes.fixture.tolist()) == ("plane", ("table", "wall"), [0, 1, 0])
    np.testing.assert_allclose(planes.values, [0.02, 0, 0])
    file.write_text("a,b,c,nx,ny,nz,height\n0,0,0,0,0.6,0.8,0.3\n")
    np.testing.assert_allclose(read(file).normals, [[0, 0.6, 0.8]])
    file.write_text("a,b,c,x,y,z,roll [deg],pitch,yaw [deg]\n0,0,0,1,2,3,0,0,90\n")
    np.testing.assert_allclose(read(file).values, quaternion, atol=1e-12)


def read(file):
    return read_table(file, ["a", "b", "c"]).measurements(1e-4, 1e-3)


FAULTS = {
    "word": (HEADER + "1,2,3,4,x,6\n", ":2:9: error: 'x' is not a number"),
    "short": (HEADER + "1,2,3\n", ":2:1: error: 3 values instead of 6"),
    "joint": ("q1,q3,x,y,z\n1,1,1,1,1\n", ":1:1: error: there is no column for joint 'q2'"),
    "kind": ("q1,q2,q3,x\n1,1,1,1\n", ":1:1: error: no column says what was measured"),
    "unit": (HEADER.replace("[mm]", "[cm]") + "1,1,1,1,1,1\n", ":1:1: error: no unit 'cm' of column 'x'"),
    "more": (HEADER.replace("\n", ",torque\n") + "1,1,1,1,1,1,1\n", ":1:1: error: the column 'torque' is not used"),
    "twice": (HEADER.replace("q2", "q1") + "1,1,1,1,1,1\n", ":1:1: error: two columns are called 'q1'"),
    "empty": (HEADER, "error: the file has no measurements"),
    "name": ("q1,q2,q3,plane\n1,1,1,the table\n", ":2:7: error: 'the table' is no name of what was touched"),
    "normal": ("q1,q2,q3,nx,ny,nz,height\n1,1,1,0,0,2,1\n", ":2:1: error: the direction nx ny nz has the length 2"),
    "quaternion": ("q1,q2,q3,x,y,z,qw,qx,qy,qz\n1,1,1,1,1,1,1,1,0,0\n", ":2:1: error: the quaternion has the length"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_of_files_are_located(case, tmp_path):
    (tmp_path / "m.csv").write_text(FAULTS[case][0])
    with pytest.raises(InputError) as caught:
        read_table(tmp_path / "m.csv", ["q1", "q2", "q3"]).measurements(1e-4, 1e-3)
    assert FAULTS[case][1] in str(caught.value)
