"""Emitted C as a whole: compilers, sanitizers, self-test, header, packaging."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from emit.c_tools import (
    C99,
    CXX,
    IDENTITY,
    SANITIZERS,
    check_all,
    compile_all,
    compiler,
    emitted,
    frames,
    run,
    write,
)
from emit.planar import planar_model
from pipeline.optimized import bundled
from rrrgen.emit.c.robot_files import CBackend, build_files
from rrrgen.emit.manifest import manifest

MODELS = {"nominal": {}, "no links": {"links": False, "drives": False}}


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("language", ["c99", "c++17"])
@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.sweep(but=["gcc-c99-double", "clang-c99-float", "gcc-c++17-float"])
def test_no_compiler_has_anything_to_complain_about(name, language, real, tmp_path):
    """Of the optimizer, which warns in gcc alone, the code of both languages is the same."""
    flags = C99 if language == "c99" else CXX
    for kind, options in MODELS.items():
        folder = emitted(planar_model(**options), tmp_path / kind, real)
        if (name, language) == ("gcc", "c99"):
            compile_all(folder, [compiler(name), *flags, "-O1"])
        else:
            check_all(folder, [compiler(name), *flags])


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads the assembler of x86-64")
@pytest.mark.parametrize("flags", [C99, CXX])
def test_no_registers_of_64_bytes_beside_scalars(flags, tmp_path):
    """They halve the rate of scalar arithmetic; gcc would gather results in them (-march=native on new processors)."""
    folder = write(CBackend().files(bundled("rrr"), IDENTITY, "double"), tmp_path)
    wide = ["-O3", "-mavx512f", "-mavx512vl", "-mprefer-vector-width=512"]
    for source in ("rrr.c", "rrr_nominal.c", "rrr_derivatives.c"):
        subprocess.run([compiler("gcc"), *flags, *wide, "-S", source, "-o", "out.s"], cwd=folder, check=True)
        assert "%xmm" in (folder / "out.s").read_text()
        assert "%zmm" not in (folder / "out.s").read_text(), source


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.sweep(but=["nominal-double", "no links-float"])
def test_the_self_test_passes_under_sanitizers(kind, real, tmp_path):
    folder = emitted(planar_model(**MODELS[kind]), tmp_path, real)
    done = run(compile_all(folder, [compiler("gcc"), *C99, *SANITIZERS]))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "planar: all checks passed" in done.stdout
    assert "FAILED" not in done.stdout


FUNCTIONS = ["forward_kinematics", "jacobian", "jacobian_dot_dq", "mass_matrix", "coriolis_matrix", "coriolis",
             "coriolis_transpose", "gravity", "bias", "inverse_dynamics", "forward_dynamics", "regressor",
             "regressor_transpose", "standard_regressor", "energy", "mass_matrix_nominal",
             "inverse_dynamics_nominal"]  # fmt: skip


def flipped(source: str, function: str) -> str:
    """``source`` with the first + between two terms of ``function`` turned into - (or - into +)."""
    start = re.search(rf"_{function}\([^)]*\)\n{{", source).end()
    end = source.index("\n}", start)
    body = source[start:end]
    sign = re.search(r" ([+-]) ", body)
    other = "-" if sign[1] == "+" else "+"
    return source[:start] + body[: sign.start(1)] + other + body[sign.end(1) :] + source[end:]


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    """The emitted files of a model, compiled one by one, and the words that compile more of them."""
    folder = emitted(planar_model(), tmp_path_factory.mktemp("right"))
    command = [compiler("gcc"), "-std=c99", "-O0"]
    subprocess.run([*command, "-c", *(path.name for path in folder.glob("*.c"))], cwd=folder, check=True)
    return folder, command


def with_another(source: str, file: str, right: tuple[Path, list[str]], folder: Path) -> Path:
    """The self-test of the emitted files with ``source`` in place of ``file``."""
    others, command = right
    (folder / file).write_text(source, encoding="utf-8")
    objects = [path for path in others.glob("*.o") if path.stem != Path(file).stem]
    words = [*command, f"-I{others}", file, *map(str, objects), "-o", "selftest", "-lm"]
    subprocess.run(words, cwd=folder, check=True)
    return folder / "selftest"


def test_the_self_test_of_right_code_passes(right, tmp_path):
    source = (right[0] / "planar.c").read_text(encoding="utf-8")
    assert run(with_another(source, "planar.c", right, tmp_path)).returncode == 0


@pytest.mark.parametrize("function", FUNCTIONS)
def test_one_wrong_sign_anywhere_fails_the_self_test(function, right, tmp_path):
    file = "planar_nominal.c" if function.endswith("_nominal") else "planar.c"
    source = (right[0] / file).read_text(encoding="utf-8")
    broken = flipped(source, function)
    assert broken != source
    done = run(with_another(broken, file, right, tmp_path))
    assert done.returncode == 1, done.stdout
    assert "FAILED" in done.stdout


@pytest.mark.parametrize("broken", ["output = nan", "status"])
def test_the_self_test_notices_what_comparisons_with_nan_would_hide(broken, right, tmp_path):
    source = right_source = (right[0] / "planar.c").read_text(encoding="utf-8")
    if broken == "status":
        source = source.replace("? PLANAR_OK : PLANAR_NOT_POSITIVE_DEFINITE", "? PLANAR_OK : PLANAR_OK")
    else:
        source = re.sub(
            r"(_gravity\([^)]*\)\n{)", r"\1 g[0] = g[1] = 0.0/0.0; if (g[0] != g[0]) return;", source, count=1
        )
    assert source != right_source
    assert run(with_another(source, "planar.c", right, tmp_path)).returncode == 1


def test_the_header_says_what_a_reader_needs():
    header = CBackend().files(planar_model(), IDENTITY, "double")["planar.h"]
    for text in (
        "#ifndef PLANAR_H",
        'extern "C"',
        "#define PLANAR_N 2",
        "#define PLANAR_B 8 /* base parameters, then drive inertias */",
        f'#define PLANAR_MODEL_HASH "{IDENTITY.model_hash}"',
        "rrrgen 0.0.0",
        "The generated code belongs to you",
        "standard Denavit-Hartenberg",
        "typedef double planar_real;",
        "Matrices are row-major",
        "must not overlap",
        "acceleration (0.0, -9.81, 0.0) m/s^2",
        "beta[0]  b1   kg m^2  Izz1 + m2/4",
        "beta[7]  Ia2  kg m^2  Ia2",
        "joint velocities",
        "Operations: ",
        "Stack: at most ",
        "PLANAR_NOT_POSITIVE_DEFINITE",
        "const planar_real q[2], planar_real T[PLANAR_RESTRICT 16]",
    ):
        assert text in header, text


def test_every_symbol_has_the_robot_s_prefix_and_none_is_data(tmp_path):
    folder = emitted(planar_model(), tmp_path)
    (folder / "planar_selftest.c").unlink()
    sources = sorted(path.stem for path in folder.glob("*.c"))
    subprocess.run([compiler("gcc"), "-std=c99", "-c", *(f"{name}.c" for name in sources)], cwd=folder, check=True)
    listing = subprocess.run(
        [compiler("nm"), "-g", *(f"{name}.o" for name in sources)],
        cwd=folder,
        check=True,
        capture_output=True,
        text=True,
    )
    symbols = [line.split()[-2:] for line in listing.stdout.splitlines() if len(line.split()) > 1]
    defined = [name for kind, name in symbols if kind != "U"]
    assert defined
    assert all(name.lstrip("_").startswith("planar_") for name in defined)
    assert {kind for kind, _ in symbols} <= {"T", "U"}, "functions only: no global data"
    undefined = {name.lstrip("_").split("@")[0] for kind, name in symbols if kind == "U"}
    assert undefined <= {"sin", "cos", "sincos", "sqrt"}, "no heap, no stdio"


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("command", ["gcc", "clang"])
def test_header_and_manifest_state_one_bound_of_the_stack(command, real, tmp_path):
    model = planar_model()
    functions = json.loads(manifest(model, IDENTITY, real, {}, {}))["functions"]
    stated = {name: function["stack"] for name, function in functions.items()}
    folder = emitted(model, tmp_path, real)
    header = (folder / "planar.h").read_text()
    printed = re.findall(r"Stack: at most (\d+) bytes built by gcc, (\d+) by clang\.\n \*/\n\w+ planar_(\w+)\(", header)
    bounds = {name: {"gcc": int(gcc), "clang": int(clang)} for gcc, clang, name in printed}
    assert len(stated) > 20
    assert stated.items() <= bounds.items()  # the header has the parameters too
    used = frames(folder / "planar.c", [compiler(command), "-O2"])
    kernel = used.get("planar_sincos", 0)
    for name in stated.keys() & {name.removeprefix("planar_") for name in used}:
        assert used[f"planar_{name}"] + kernel <= stated[name][command], name


def test_nothing_in_the_files_depends_on_when_and_where_they_are_made(tmp_path):
    script = (
        "import hashlib, sys; sys.path[:0] = sys.argv[1:]\n"
        "from emit.planar import planar_model\n"
        "from emit.c_tools import IDENTITY\n"
        "from rrrgen.emit.c.robot_files import CBackend\n"
        "files = CBackend().files(planar_model(), IDENTITY, 'double')\n"
        "print(hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest())\n"
    )
    root = Path(__file__).resolve().parents[2]
    seed = "31337" if os.environ.get("PYTHONHASHSEED") == "0" else "0"  # another one than here
    done = subprocess.run(
        [sys.executable, "-c", script, str(root), str(root / "tests")],
        env={**os.environ, "PYTHONHASHSEED": seed, "TZ": "UTC+7"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    files = CBackend().files(planar_model(), IDENTITY, "double")
    assert done.stdout.strip() == hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()


CONSUMER = """#include <planar.h>
#include <stdio.h>
int main(void)
{
    const planar_real q[PLANAR_N] = {0.0, 0.0};
    planar_real T[16];
    planar_forward_kinematics(q, T);
    printf("%.3f\\n", (double)T[3]);
    return 0;
}
"""


def project(folder: Path, lines: str) -> Path:
    text = f"cmake_minimum_required(VERSION 3.14)\nproject(consumer C)\n{lines}\n"
    text += "add_executable(consumer main.c)\ntarget_link_libraries(consumer PRIVATE planar::planar)\n"
    return write({"CMakeLists.txt": text, "main.c": CONSUMER}, folder)


def cmake(*arguments: object) -> None:
    done = subprocess.run(["cmake", *map(str, arguments)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def packaged(folder: Path) -> Path:
    files = CBackend().files(planar_model(), IDENTITY, "double")
    return write({**files, **build_files(files, planar_model(), IDENTITY, "double")}, folder)


def built(folder: Path, build: Path, *options: str) -> Path:
    cmake("-S", folder, "-B", build, "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_C_FLAGS_RELEASE=-O0", *options)
    cmake("--build", build)
    return build


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """The sources of a package, its build, and where it was moved after its installation: it must work anywhere."""
    if shutil.which("cmake") is None:
        pytest.skip("cmake is not installed")
    folder = tmp_path_factory.mktemp("package")
    source = packaged(folder / "planar")
    build = built(source, folder / "build", f"-DCMAKE_INSTALL_PREFIX={folder / 'first'}")
    cmake("--install", build)
    (folder / "first").rename(folder / "moved")
    return source, build, folder / "moved"


def test_cmake_builds_tests_and_serves_both_kinds_of_consumers(package, tmp_path):
    source, build, prefix = package
    assert run(build / "planar_selftest").returncode == 0
    finds = project(tmp_path / "finds", "find_package(planar REQUIRED)")
    adds = project(tmp_path / "adds", f"add_subdirectory({source.as_posix()} planar)")
    for folder, option in ((finds, f"-DCMAKE_PREFIX_PATH={prefix}"), (adds, "-DUNUSED=1")):
        assert run(built(folder, folder / "build", option) / "consumer").stdout == "0.850\n"
    assert not (adds / "build" / "planar" / "planar_selftest").exists(), "a consumer does not build our tests"


def test_pkg_config_points_into_the_place_where_the_package_lies(package, tmp_path):
    if shutil.which("pkg-config") is None:
        pytest.skip("pkg-config is not installed")
    _, _, prefix = package
    flags = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "planar"],
        env={**os.environ, "PKG_CONFIG_PATH": str(prefix / "lib" / "pkgconfig")},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    write({"main.c": CONSUMER}, tmp_path)
    subprocess.run([compiler("gcc"), "main.c", "-o", "main", *flags], cwd=tmp_path, check=True)
    assert run(tmp_path / "main").stdout == "0.850\n"


def test_two_robots_live_in_one_program(tmp_path):
    for name in ("left", "right"):
        emitted(planar_model(name), tmp_path)
    for unused in tmp_path.glob("*_selftest.c"):
        unused.unlink()
    main = '#include "left.h"\n#include "right.h"\nint main(void) { return LEFT_N - RIGHT_N; }\n'
    assert run(compile_all(write({"main.c": main}, tmp_path), [compiler("gcc"), *C99])).returncode == 0


def test_a_description_with_the_end_of_a_comment_does_no_harm(tmp_path):
    model = planar_model()
    evil = dataclasses.replace(model.spec, description="*/ #error no /* \\")
    folder = emitted(dataclasses.replace(model, spec=evil), tmp_path)
    compile_all(folder, [compiler("gcc"), *C99])
