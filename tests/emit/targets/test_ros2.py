"""The plugins for ROS 2, compiled against stand-ins of the interfaces, and called through the base classes."""

from __future__ import annotations

import re
import shutil
import xml.etree.ElementTree as ElementTree
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from emit.targets.arm import arm
from emit.targets.compared import ours
from emit.targets.rrr_library import run
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec

STAND_INS = Path(__file__).with_name("ros2_stand_ins")

COMPILER = shutil.which("clang++") or shutil.which("g++")  # of the templates of Eigen clang takes half the time

PROGRAM = """\
#include "src/dynamics.cpp"
#include "src/kinematics.cpp"
#include "src/moveit.cpp"
#include <cstdio>

#define REQUIRE(x) do { if (!(x)) { std::printf("line %d: %s\\n", __LINE__, #x); return 1; } } while (0)

int main()
{
    using Interface = rclcpp::node_interfaces::NodeParametersInterface;
    const auto given = std::make_shared<Interface>();
    Eigen::VectorXd q(4), dq(4), ddq(4);
    q << 0.3, -0.8, 0.1, 0.5;
    dq << 0.5, 0.25, -0.1, 1.0;
    ddq << -1.0, 2.0, 0.5, 0.25;

    auto dynamics = make<inverse_dynamics_solver::InverseDynamicsSolver>();
    dynamics->initialize(given, "dynamics");
    const Eigen::VectorXd tau = dynamics->getTorques(q, dq, ddq);
    const auto [M, c, g] = dynamics->getDynamicParameters(q, dq);
    REQUIRE((M * ddq + c + g - tau).norm() < 1e-12);
    REQUIRE((dynamics->getInertiaMatrix(q) - M).norm() < 1e-12 && (dynamics->getGravityVector(q) - g).norm() < 1e-12);
    REQUIRE((dynamics->getCoriolisVector(q, dq) - c).norm() < 1e-12);
    REQUIRE(dynamics->getFrictionVector(dq).size() == 4);
    given->known["dynamics.beta"] = {std::vector<double>(SCARA_B, 0.0), ""};
    dynamics->initialize(given, "dynamics");
    REQUIRE(dynamics->getGravityVector(q).norm() == 0.0);
    given->known["dynamics.beta"] = {{1.0}, ""};
    try {
        dynamics->initialize(given, "dynamics");
        return 2;
    } catch (const std::invalid_argument &error) {
        REQUIRE(std::string(error.what()).find("dynamics.beta has 1 numbers") != std::string::npos);
    }

    auto kinematics = make<kinematics_interface::KinematicsInterface>();
    given->known["kinematics.tip"] = {{}, "tool0"};
    REQUIRE(kinematics->initialize("", given, "kinematics"));
    Eigen::Isometry3d T, moved;
    Eigen::Matrix<double, 6, 1> twist, back;
    Eigen::VectorXd speeds;
    REQUIRE(kinematics->calculate_link_transform(q, "tool0", T) && !kinematics->calculate_link_transform(q, "tip", T));
    REQUIRE(kinematics->convert_joint_deltas_to_cartesian_deltas(q, dq, "tool0", twist));
    REQUIRE(kinematics->convert_cartesian_deltas_to_joint_deltas(q, twist, "tool0", speeds));
    REQUIRE((speeds - dq).norm() < 1e-5);
    const Eigen::VectorXd later = q + 1e-6 * dq;
    REQUIRE(kinematics->calculate_link_transform(later, "tool0", moved));
    Eigen::Matrix<double, 7, 1> a, b;
    a << T.translation(), Eigen::Quaterniond(T.rotation()).coeffs();
    b << moved.translation(), Eigen::Quaterniond(moved.rotation()).coeffs();
    REQUIRE(kinematics->calculate_frame_difference(a, b, 1e-6, back) && (back - twist).norm() < 1e-4);

    auto solver = make<kinematics::KinematicsBase>();
    REQUIRE(solver->initialize(nullptr, {}, "arm", "base", {"tool0"}, 0.1));
    std::vector<geometry_msgs::msg::Pose> poses;
    const std::vector<double> seed(q.data(), q.data() + 4);
    REQUIRE(solver->getPositionFK({"tool0"}, seed, poses) && !solver->getPositionFK({"other"}, seed, poses));
    REQUIRE(solver->getPositionFK({"tool0"}, seed, poses) && std::abs(poses[0].position.x - T(0, 3)) < 1e-12);
    const auto &o = poses[0].orientation;
    REQUIRE((Eigen::Quaterniond(o.w, o.x, o.y, o.z).toRotationMatrix() - T.rotation()).norm() < 1e-12);
    std::vector<double> found;
    std::vector<std::vector<double>> all;
    moveit_msgs::msg::MoveItErrorCodes code;
    kinematics::KinematicsResult result;
    REQUIRE(solver->getPositionIK(poses[0], seed, found, code) && code.val == 1);
    for (int i = 0; i < 4; i++) {
        REQUIRE(std::abs(found[i] - seed[i]) < 1e-9);
    }
    REQUIRE(solver->getPositionIK(poses, seed, all, result, {}) && all.size() == 2);
    int asked = 0;
    const auto second = [&asked](const auto &, const auto &, auto &answer) { answer.val = ++asked < 2 ? 99999 : 1; };
    REQUIRE(solver->searchPositionIK(poses[0], seed, 1.0, found, second, code) && std::abs(found[1] - seed[1]) > 0.1);
    REQUIRE(!solver->searchPositionIK(poses[0], {3.0, 0.0, 0.0, 0.0}, 1.0, std::vector<double>(4, 0.01), found, code));
    poses[0].position.x = 9.0;
    REQUIRE(!solver->searchPositionIK(poses[0], seed, 1.0, found, code) && code.val == -31);
    REQUIRE(solver->getJointNames().size() == 4);
    for (int i = 0; i < 4; i++) {
        std::printf("%.17g ", tau[i]);
    }
    for (int i = 0; i < 16; i++) {
        std::printf("%.17g ", T(i / 4, i % 4));
    }
    return 0;
}
"""


AMENT = """\
function(ament_target_dependencies target)
  target_include_directories(${target} SYSTEM PUBLIC ${STAND_INS} ${EIGEN})
endfunction()
function(pluginlib_export_plugin_description_file interface file)
  install(FILES ${file} DESTINATION share/${PROJECT_NAME})
endfunction()
function(ament_package)
  install(FILES package.xml DESTINATION share/${PROJECT_NAME})
endfunction()
"""
"""Stand-ins of the functions that packages of ROS 2 get from ament_cmake."""


def headers_of_eigen() -> Path:
    """The folder that holds eigen3: that of CasADi's package, or of the system."""
    casadi = find_spec("casadi")
    eigen = Path("/usr/include") if casadi is None else Path(casadi.submodule_search_locations[0]) / "include"
    if not (eigen / "eigen3" / "Eigen" / "Core").is_file():
        pytest.skip("needs the headers of Eigen")
    return eigen


def written(files, place: Path) -> Path:
    for name, text in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text, encoding="utf-8")
    return place


@pytest.fixture(scope="module")
def package():
    return export_robot(load_spec("scara"), "ros2").files


@pytest.fixture(scope="module")
def folder(package, tmp_path_factory):
    return written(package, tmp_path_factory.mktemp("ros2"))


@pytest.mark.skipif(COMPILER is None, reason="needs clang++ or g++")
def test_the_plugins_answer(folder):
    eigen = headers_of_eigen()
    (folder / "use.cpp").write_text(PROGRAM, encoding="utf-8")
    for source in ("scara.c", "scara_nominal.c", "scara_ik.c"):
        run("gcc", "-std=c99", "-O0", "-c", source, "-o", folder / f"{source}.o", cwd=folder / "model")
    includes = ["-isystem", eigen, "-isystem", eigen / "eigen3", f"-I{STAND_INS}", "-Imodel", "-Isrc"]
    # two functions cannot be marked override: the interface has them in some versions of ROS 2 only
    warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-Wno-inconsistent-missing-override"]
    objects = [each.name for each in folder.glob("*.o")]
    run(
        COMPILER,
        "-std=c++17",
        "-O0",
        "-DEIGEN_DONT_VECTORIZE",
        *warnings,
        *includes,
        "use.cpp",
        *objects,
        "-lm",
        "-o",
        "use",
        cwd=folder,
    )
    numbers = np.array(run(folder / "use").split(), dtype=float)
    state = ([0.3, -0.8, 0.1, 0.5], [0.5, 0.25, -0.1, 1.0], [-1.0, 2.0, 0.5, 0.25])
    T, tau = ours(load_spec("scara"), *(np.array([each]) for each in state))
    np.testing.assert_allclose(numbers[:4], tau[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(numbers[4:].reshape(4, 4), T[0], atol=1e-14)


def test_the_friction_parameter_has_the_size_of_the_model_function():
    files = export_robot(arm(), "ros2").files
    size = re.search(r"friction_with\([^)]*\bfriction\[(\d+)\]", files["model/arm.h"])[1]
    assert f"double friction_[{size}] = {{}};" in files["src/dynamics.cpp"]
    assert f'"friction", friction_, {size});' in files["src/dynamics.cpp"]


@pytest.mark.parametrize(("robot", "said"), [("planar2r", True), ("scara", False)])
def test_a_note_says_where_no_plugin_for_moveit_is_written(robot, said):
    """An arm whose targets are positions has none, though its inverse kinematics is solved."""
    exported = export_robot(load_spec(robot), "ros2")
    assert ("src/moveit.cpp" not in exported.files) == said
    assert any("no plugin for MoveIt" in note for note in exported.notes) == said


def test_the_package_is_consistent(folder):
    """Every plugin that is described exists, and every library is built."""
    package = ElementTree.parse(folder / "package.xml").getroot()
    assert package.findtext("name") == "scara_ros"
    build = (folder / "CMakeLists.txt").read_text(encoding="utf-8")
    for described in folder.glob("*_plugin.xml"):
        library = ElementTree.parse(described).getroot()
        kind = library.find("class")
        source = (folder / "src" / f"{library.get('path').removeprefix('scara_')}.cpp").read_text(encoding="utf-8")
        assert f"PLUGINLIB_EXPORT_CLASS({kind.get('type')}, {kind.get('base_class_type')})" in source
        assert f"add_library({library.get('path')} SHARED" in build
        assert described.name in build
    needed = {each.text for each in package.findall("depend")}
    assert {"pluginlib", "rclcpp", "inverse_dynamics_solver", "kinematics_interface", "moveit_core"} <= needed


@pytest.mark.skipif(shutil.which("colcon") is None, reason="needs colcon (pip install colcon-common-extensions)")
def test_colcon_builds_and_installs_the_package(package, tmp_path):
    """With stand-ins of the packages that it depends on."""
    place, found = written(package, tmp_path / "src" / "scara_ros"), tmp_path / "found" / "lib" / "cmake"
    needed = {each.text for each in ElementTree.parse(place / "package.xml").getroot().findall("depend")} - {"eigen"}
    for name in ("ament_cmake", "Eigen3", *needed):
        (found / name).mkdir(parents=True)
        (found / name / f"{name}Config.cmake").write_text(AMENT if name == "ament_cmake" else "", encoding="utf-8")
    eigen = headers_of_eigen()
    folders = (
        f"-DSTAND_INS={STAND_INS}",
        f"-DEIGEN={eigen};{eigen / 'eigen3'}",
        "-DCMAKE_CXX_FLAGS=-DEIGEN_DONT_VECTORIZE",
    )
    options = ("--executor", "sequential", "--cmake-args", f"-DCMAKE_PREFIX_PATH={tmp_path / 'found'}", *folders)
    run("colcon", "--log-base", "log", "build", *options, cwd=tmp_path, timeout=600)
    installed = {path.name for path in (tmp_path / "install" / "scara_ros").rglob("*") if path.is_file()}
    for plugin in ("dynamics", "kinematics", "moveit"):
        assert {f"libscara_{plugin}.so", f"{plugin}_plugin.xml"} <= installed
    assert {"parameters.yaml", "package.xml"} <= installed
