"""The C++17 header: warning-free, with the numbers of the C where its types say, for Eigen too; the C++ of its page."""

from __future__ import annotations

import re
import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from emit.targets.rrr_library import GENERATED, SOURCES, STRICT, library, run
from pages.test_pages import ROOT, blocks
from pipeline.optimized import bundled
from rrrgen.cli.main import run as generate
from rrrgen.emit.targets.cpp import CppBackend, namespace
from rrrgen.robot.identity import identify

pytestmark = pytest.mark.skipif(shutil.which("g++") is None, reason="needs g++")

PROGRAM = """\
#include "rrr.hpp"
#include <cstdio>
#include <cstring>

#define SAME(a, b) do { if (std::memcmp((a), (b), sizeof(b)) != 0) { std::puts(#a); return 1; } } while (0)

#ifdef RRR_EIGEN
void page(const rrr::vector<3> &, const rrr::vector<3> &, const rrr::vector<3> &, const rrr::vector<15> &);
void page(const rrr::vector<3> &q, const rrr::vector<3> &dq, const rrr::vector<3> &tau, const rrr::vector<15> &beta)
{
@PAGE@    static_cast<void>(x);
}
#endif

int main()
{
    const rrr::vector<3> q{0.3, -0.4, 0.5}, dq{0.1, 0.2, 0.3}, tau{1.0, 2.0, 3.0};
    const rrr::vector<15> beta = rrr::nominal_parameters();
    rrr_real T[16], J[18], all[48], ddq[3], M[9];
    rrr_kinematics(q.data(), T, J);
    const auto [pose, jacobian] = rrr::kinematics(q);
    SAME(pose.data(), T);
    SAME(jacobian.data(), J);
    if (jacobian(5, 1) != J[5 * 3 + 1]) {
        return 2;
    }
    rrr_link_frames(q.data(), all);
    const auto frames = rrr::link_frames(q);
    SAME(frames[0].data(), all);
    if (frames[2](1, 3) != all[2 * 16 + 7]) {
        return 3;
    }
    const auto motion = rrr::forward_dynamics(q, dq, tau, beta);
    if (!motion || rrr_forward_dynamics(q.data(), dq.data(), tau.data(), beta.data(), ddq) != RRR_OK) {
        return 4;
    }
    SAME(motion.ddq.data(), ddq);
    if (rrr::forward_dynamics(q, dq, tau, rrr::vector<15>{})) { // M = 0
        return 5;
    }
    const auto solved = rrr::inverse_kinematics({pose(0, 3), pose(1, 3), pose(2, 3)}, q, RRR_IK_NEAREST);
    if (!solved || !(std::abs(solved.rows.q[0][1] - q[1]) < 1e-9)) {
        return 6;
    }
    rrr_mass_matrix_nominal(q.data(), M);
    auto mass = rrr::mass_matrix_nominal(q);
    SAME(mass.data(), M);
    static_assert(rrr::joints == 3 && rrr::base_parameter_count == 15, "sizes");
    if (std::strcmp(rrr::joint_names[2], "q3") != 0 || !(rrr::tau_max[1] > 29.9) || std::isfinite(rrr::q_max[0])) {
        return 7;
    }
#ifdef RRR_EIGEN
    const Eigen::Vector3d product = rrr::map(mass) * rrr::map(dq);
    rrr::map(mass)(0, 2) = 7.0;
    const double expected = M[3] * dq[0] + M[4] * dq[1] + M[5] * dq[2];
    if (!(std::abs(product[1] - expected) < 1e-12) || mass(0, 2) != 7.0) {
        return 8;
    }
#endif
    return 0;
}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("cpp")
    model, backend = bundled("rrr"), CppBackend()
    identity = identify(model.spec)
    files = backend.assemble(model, identity, [task() for task in backend.tasks(model, identity, "double")])
    (page,) = blocks((ROOT / "docs/generated-code.md").read_text(encoding="utf-8"), "cpp")
    for name, text in {**files, "use.cpp": PROGRAM.replace("@PAGE@", page)}.items():
        (place / name).write_text(text, encoding="utf-8")
    return place


def eigen() -> Path | None:
    """The folder of Eigen's headers, which CasADi's wheel has too."""
    casadi = find_spec("casadi")
    places = [] if casadi is None else [Path(each) / "include" for each in casadi.submodule_search_locations]
    found = [place / "eigen3" for place in [Path("/usr/include"), *places]]
    return next((place for place in found if (place / "Eigen" / "Core").is_file()), None)


def test_results_are_those_of_the_c(folder):
    """Also through maps of Eigen where its headers are."""
    maps = ["-DRRR_EIGEN", "-isystem", eigen()] if eigen() else []
    run("g++", "-std=c++17", *STRICT, *maps, f"-I{GENERATED}", "use.cpp", library(), "-o", "use", cwd=folder)
    run(folder / "use")


@pytest.mark.skipif(shutil.which("clang++") is None, reason="needs clang++")
def test_clang_has_no_complaints(folder):
    run("clang++", "-std=c++17", *STRICT, f"-I{GENERATED}", "-fsyntax-only", "use.cpp", cwd=folder)


def test_every_function_of_the_header_is_there(folder):
    declared = set(re.findall(r"^\w+ rrr_(\w+)\(", (GENERATED / "rrr.h").read_text(encoding="utf-8"), re.M))
    wrapped = set(re.findall(r"inline .*?(\w+)\(.*", (folder / "rrr.hpp").read_text(encoding="utf-8")))
    assert declared - {"status_string"} <= wrapped


def test_names_that_c_has_already_are_no_namespaces():
    for taken in ("std", "size_t", "unix", "FP_NAN", "INT_MAX"):
        assert namespace(taken) == f"{taken}_model"
    assert namespace("UF_ROBOT") == "UF_ROBOT"
    assert namespace("rrr") == "rrr"


def test_the_readme_is_right(tmp_path):
    """Its program is compiled with the command beside it."""
    text = (GENERATED / "README.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```c\n(.*?)```", text, re.S)
    (tmp_path / "main.c").write_text(program, encoding="utf-8")
    (command,) = re.findall(r"^cc .* main\.c (.*) -lm -o main$", text, re.M)
    assert command.split() == sorted(SOURCES)
    run("gcc", "-std=c99", *STRICT, f"-I{GENERATED}", "main.c", library(), "-lm", "-o", "main", cwd=tmp_path)
    assert "torque of joint 3" in run(tmp_path / "main")


TIPS = """\
#include "hand.hpp"
#include <cstring>

int main()
{
    const hand::matrix<4, 4> target{1, 0, 0, 0.05, 0, 1, 0, 0.02, 0, 0, 1, 0.03, 0, 0, 0, 1};
    const hand::vector<3> q{0.1, 0.2, 0.3};
    const auto found = hand::thumb_inverse_kinematics(target, q, HAND_THUMB_IK_NEAREST);
    hand_thumb_ik_solutions rows;
    const auto status = hand_thumb_inverse_kinematics(target.data(), q.data(), HAND_THUMB_IK_NEAREST, &rows);
    return found.status == status && found.rows.count == rows.count
        && std::strcmp(found.text(), hand_thumb_ik_status_string(status)) == 0 ? 0 : 1;
}
"""


@pytest.mark.sweep  # generates a robot with all its files; what it shows beside the C is one block of the template
def test_named_tips_have_their_solvers(tmp_path):
    """For the joints that move the tip alone; the unnamed tip of a branching robot has none."""
    words = ["generate", str(ROOT / "examples/trees/hand.yaml"), "-o", str(tmp_path), "--with", "cpp"]
    assert generate([*words, "--no-casadi-files"]) == 0
    text = (tmp_path / "hand.hpp").read_text(encoding="utf-8")
    assert "thumb_closest(" in text
    assert " inverse_kinematics(" not in text
    (tmp_path / "use.cpp").write_text(TIPS, encoding="utf-8", newline="\n")
    run("gcc", "-c", "-O0", "hand_thumb_ik.c", cwd=tmp_path)
    run("g++", "-std=c++17", *STRICT, "-I.", "use.cpp", "hand_thumb_ik.o", "-lm", "-o", "use", cwd=tmp_path)
    run(tmp_path / "use")


def test_a_robot_may_be_called_like_a_type_of_its_namespace(tmp_path):
    words = ["generate", "pendulum", "-o", str(tmp_path), "--with", "cpp,control", "--no-casadi-files"]
    assert generate(words) == 0
    header = (tmp_path / "pendulum.hpp").read_text(encoding="utf-8")
    assert "differential_ik_limits" in header
    for name in ("vector", "matrix", "real"):
        for file in tmp_path.glob("pendulum*.h*"):
            text = file.read_text(encoding="utf-8").replace("pendulum", name).replace("PENDULUM", name.upper())
            (tmp_path / file.name.replace("pendulum", name)).write_text(text, encoding="utf-8", newline="\n")
        (tmp_path / "use.cpp").write_text(f'#include "{name}.hpp"\n', encoding="utf-8")
        run("g++", "-std=c++17", "-fsyntax-only", "-I.", "use.cpp", cwd=tmp_path)
