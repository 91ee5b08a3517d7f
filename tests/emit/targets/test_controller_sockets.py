"""One closed loop of the controller with changes of mode, faults and a push, through every socket: the same bits.

``pytest tests/emit/targets/test_controller_sockets.py -rs`` runs it through all of them,
and says which tools are missing.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from bench.machines import MACHINES
from emit.targets.arm import arm
from emit.targets.rrr_library import STRICT, run
from emit.targets.test_embedded import check_sample, check_sketch
from rrrgen.controller.files import rust_files, standalone_files
from rrrgen.controller.python_class import Controller
from rrrgen.controller.table import GROUPS, unit_of
from rrrgen.emit import Real
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.runtime.controller import compiled_controller
from rrrgen.runtime.model import Model

STAND_INS = Path(__file__).with_name("ros2_stand_ins")

TICKS = 300
SET = {"kp": 150.0, "threshold": 25.0}


def reference_of_the_arm(model: Model, t: float) -> dict[str, np.ndarray]:
    """Where the arm should be at the time ``t``, in joints and at the tip."""
    w = np.array([2.0, 3.0])
    q_d = [0.3, -0.8] + 0.2 * np.sin(w * t)
    dq_d, ddq_d = 0.2 * w * np.cos(w * t), -0.2 * w**2 * np.sin(w * t)
    tip = model.jacobian(q_d) @ dq_d
    return {"q_d": q_d, "dq_d": dq_d, "ddq_d": ddq_d, "T_d": model.forward_kinematics(q_d).ravel(), "V_d": tip}


def damage(row: np.void, tick: int, sample: int) -> None:
    """A fault of every kind, each at its tick."""
    if tick in (31, 32):
        row["q"] = np.nan
    if tick == 75:
        row["dq"][1] = np.inf
    if tick == 95:
        row["q"] += 1.0
    if tick == 115:
        row["sample"] = sample
    if tick in (140, 141):
        row["dt"] = 5e-3 if tick == 140 else np.nan
    if tick == 160:
        row["mode"] = 99
    if 200 <= tick < 230:  # longer than is bridged: the brake
        row["q"][0] = np.nan
    if tick == 290:
        row["q_d"][0] = row["T_d"][0] = row["V_d"][0] = np.nan


PUSH = slice(50, 70)
"""The ticks in which somebody pushes at the elbow, with 60 N m."""

RESET = 245
"""Before this tick the controller is reset, after the brake; the readings are those of the tick before."""


def closed_loop(controller: Controller) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and outputs of every tick: the arm follows a motion in every mode by turns, with faults and a push.

    A socket that gives these outputs for these inputs, bit for bit, would have closed the same loop.
    """
    model = rrrgen.compile(arm())
    inputs, outputs = (np.zeros(TICKS, each.data.dtype) for each in (controller._input, controller._output))
    modes = list(controller.description["modes"].values())
    q, dq = np.array([0.3, -0.8]), np.array([0.4, 0.6])
    controller.start(q=q, dq=dq)
    for k in range(TICKS):
        given = {"q": q, "dq": dq, **reference_of_the_arm(model, 1e-3 * k), "dt": 1e-3, "sample": k + 1}
        for name, value in (given | {"mode": modes[k // 20 % len(modes)]}).items():
            inputs[name][k] = value
        damage(inputs[k], k, k)
        if k == RESET:
            controller.reset(**{name: inputs[name][k - 1] for name in inputs.dtype.names})
        outputs[k : k + 1] = controller.run({name: inputs[name][k : k + 1] for name in inputs.dtype.names})
        push = np.array([0.0, 60.0 if PUSH.start <= k < PUSH.stop else 0.0])
        dq = dq + 1e-3 * model.forward_dynamics(q, dq, outputs["tau"][k] + push) * (1 - outputs["brake"][k])
        dq = dq * (1 - outputs["brake"][k])
        q = q + 1e-3 * dq
    return inputs, outputs


def compare(found: np.ndarray, expected: np.ndarray) -> None:
    """The same bits: the compilers optimize differently, but contract no products and sums."""
    for name in expected.dtype.names:
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


@pytest.fixture(scope="module")
def reference() -> tuple[np.ndarray, np.ndarray]:
    controller = compiled_controller(arm(), "double", None, None, None, dict(SET))
    inputs, outputs = closed_loop(controller)
    assert {0, 1, 2, 3} <= set(outputs["phase"])
    told = controller.faults(int(np.bitwise_or.reduce(outputs["status"])))
    faults = {"NOT_FINITE", "JUMP", "STALE", "PERIOD", "REFERENCE", "MODE"}
    assert told.keys() >= faults | {"SATURATED", "CONTACT", "CONTACT_UNKNOWN"}
    return inputs, outputs


def exported(target: str, place: Path, **options) -> Path:
    files = export_robot(arm(), target, options=ExportOptions(further=("controller",), **options)).files
    for name, contents in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    return place


C = """
#include <stdio.h>
#include "arm_controller.h"

int main(void)
{
    arm_controller_params params;
    arm_controller_state state;
    arm_controller_input in, first = {0}, before = {0};
    arm_controller_output out;
    FILE *inputs = fopen("inputs", "rb"), *outputs = fopen("outputs", "wb");
    int k;
    arm_controller_default(&params);
    for (k = 0; k < 2; k++) {
        params.kp[k] = 150;
        params.threshold[k] = 25;
    }
    for (k = 0; fread(&in, sizeof(in), 1, inputs) == 1; k++) {
        if (k == 0) {
            first.q[0] = in.q[0], first.q[1] = in.q[1], first.dq[0] = in.dq[0], first.dq[1] = in.dq[1];
            if (arm_controller_init(&state, &params, &first) != 0) return 1;
        }
        if (k == 245 && arm_controller_reset(&state, &before) != 0) return 2;
        arm_controller_step(&state, &in, &out);
        before = in;
        fwrite(&out, sizeof(out), 1, outputs);
    }
    fclose(inputs);
    return fclose(outputs);
}
"""


def in_c(place: Path, inputs: np.ndarray, real: Real) -> list[str]:
    """Write the program in C with the controller, and the inputs that it reads; the names of its sources."""
    files = standalone_files(unit_of(derived_model(arm(), GROUPS)[0]), real) | {"main.c": C}
    for name, text in files.items():
        (place / name).write_text(text, encoding="utf-8")
    (place / "inputs").write_bytes(inputs.tobytes())
    return [name for name in files if name.endswith(".c")]


def test_c(reference, tmp_path):
    """A program of its own, under the sanitizers."""
    inputs, outputs = reference
    sources = in_c(tmp_path, inputs, "double")
    checked = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    run("gcc", "-std=c99", "-O1", "-ffp-contract=off", *checked, *sources, "-lm", "-o", "use", cwd=tmp_path)
    run(tmp_path / "use", cwd=tmp_path)
    compare(np.frombuffer((tmp_path / "outputs").read_bytes(), outputs.dtype), outputs)


@pytest.mark.parametrize("real", ["double", "float"])
def test_c_on_a_microcontroller(reference, real, tmp_path):
    """The same program on an emulated Cortex-M4F, whose unit is that of float; QEMU passes it the files."""
    machine = MACHINES["cortex-m4f"]
    if machine.missing:
        pytest.skip(f"needs {', '.join(machine.missing)}")
    inputs, outputs = reference
    if real == "float":
        inputs, outputs = closed_loop(compiled_controller(arm(), "float", None, None, None, dict(SET)))
    program = machine.build(tmp_path, in_c(tmp_path, inputs, real), "-O1")
    run(*machine.runner, program, cwd=tmp_path)
    compare(np.frombuffer((tmp_path / "outputs").read_bytes(), outputs.dtype), outputs)


WHEEL = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from arm_model import Controller

inputs = np.load(sys.argv[2])
c = Controller("gravity", kp=150.0, threshold=25.0)
c.start(q=inputs["q"][0], dq=inputs["dq"][0])
before = c.run({name: inputs[name][:245] for name in inputs.dtype.names})
c.reset(**{name: inputs[name][244] for name in inputs.dtype.names})
after = c.run({name: inputs[name][245:] for name in inputs.dtype.names})
np.save(sys.argv[2], np.concatenate([before, after]))
try:
    c.set(kp=float("nan"))
except ValueError as error:
    assert "kp[0]" in str(error)
"""


def test_wheel(reference, tmp_path):
    inputs, outputs = reference
    (wheel,) = exported("wheel", tmp_path).glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    np.save(tmp_path / "run.npy", inputs)
    run(sys.executable, "-I", "-c", WHEEL, tmp_path / "site", tmp_path / "run.npy")
    compare(np.load(tmp_path / "run.npy"), outputs)


MEX = """
params = arm.controller('default');
params.kp(:) = 150; params.threshold(:) = 25;
file = fopen('inputs.txt'); rows = fscanf(file, '%f', [COLUMNS, Inf])'; fclose(file);
names = {NAMES}; widths = [WIDTHS]; last = cumsum(widths);
found = fopen('outputs.txt', 'w');
for k = 1:size(rows, 1)
  for f = 1:numel(names)
    in.(names{f}) = rows(k, last(f) - widths(f) + 1 : last(f))';
  end
  if k == 1
    state = arm.controller('init', params, struct('q', in.q, 'dq', in.dq));
  elseif k == 246
    state = arm.controller('reset', state, before);
  end
  [out, state] = arm.controller('step', state, in);
  before = in;
  fprintf(found, '%.17g ', struct2cell(out){:}); fprintf(found, '\\n');
end
fclose(found);
function refused(call, id, text)
  try
    call();
  catch err
    assert(err.identifier, id);
    assert(! isempty(strfind(err.message, text)));
    return
  end
  error('nothing was refused');
end
params.kp(2) = -1;
refused(@() arm.controller('set', state, params), 'arm:parameter', 'kp[1]');
refused(@() arm.controller('step', state, struct('qd', 1)), 'arm:name', 'qd');
"""


def flat(rows: np.ndarray) -> np.ndarray:
    """Every field of the rows as columns (ticks, columns), float64."""
    return np.hstack([rows[name].reshape(len(rows), -1).astype(float) for name in rows.dtype.names])


def unflat(columns: np.ndarray, dtype: np.dtype) -> np.ndarray:
    found, at = np.zeros(len(columns), dtype), 0
    for name in dtype.names:
        size = int(np.prod(dtype[name].shape, dtype=int))
        found[name] = columns[:, at : at + size].reshape(found[name].shape)
        at += size
    return found


@pytest.mark.skipif(shutil.which("mkoctfile") is None, reason="needs Octave and its headers (octave-dev)")
def test_mex_in_octave(reference, tmp_path):
    inputs, outputs = reference
    folder = exported("matlab", tmp_path)
    np.savetxt(folder / "inputs.txt", flat(inputs), "%.17g")
    names = inputs.dtype.names
    widths = [int(np.prod(inputs.dtype[name].shape, dtype=int)) for name in names]
    words = {"COLUMNS": sum(widths), "NAMES": ", ".join(f"'{n}'" for n in names), "WIDTHS": " ".join(map(str, widths))}
    text = MEX
    for word, value in words.items():
        text = text.replace(word, str(value))
    (folder / "use.m").write_text("1;\n" + text, encoding="utf-8")
    run("octave-cli", "-q", "--eval", "setenv('CFLAGS', '-O1 -ffp-contract=off'); build_arm; use", cwd=folder)
    compare(unflat(np.loadtxt(folder / "outputs.txt"), outputs.dtype), outputs)


def reset_with_its_tick(c: Controller, inputs: np.ndarray) -> np.ndarray:
    """The outputs of the unit where the reset takes the readings of the tick that follows it, not of the one before."""
    c.start(q=inputs["q"][0], dq=inputs["dq"][0])
    before = c.run({name: inputs[name][:RESET] for name in inputs.dtype.names})
    c.reset(**{name: inputs[name][RESET] for name in inputs.dtype.names})
    return np.concatenate([before, c.run({name: inputs[name][RESET:] for name in inputs.dtype.names})])


OF_UNIT = ["arm_controller.c", "arm_controller_laws.c", "arm_differential_ik.c"]


def test_block_of_simulink(reference, tmp_path):
    """The function of the block, called as Simulink does: memory, parameters and signals are arrays of double."""
    inputs, _ = reference
    inputs = inputs.copy()
    c = compiled_controller(arm(), "double", None, None, None, dict(SET))
    expected = reset_with_its_tick(c, inputs)
    source = exported("matlab", tmp_path) / "src"
    files = ["arm.c", "arm_nominal.c", *OF_UNIT, "arm_simulink.c"]
    options = ["-std=c99", *STRICT, "-O1", "-ffp-contract=off", "-fPIC", "-shared"]
    files += [path.name for path in source.glob("*.c") if re.search("derivatives", path.name)]
    run("gcc", *options, *files, "-lm", "-o", "simulink.so", cwd=source)
    call = ctypes.CDLL(str(source / "simulink.so")).arm_sl_controller
    given = [np.array(c.params.data[name], dtype=float).reshape(-1) for name in c.params.data.dtype.names[2:]]
    work = np.zeros((c.description["state_size"] + c.description["structs"]["params"]["size"]) // 8 + 1)
    found = np.zeros(len(inputs), expected.dtype)
    for k in range(len(inputs)):
        read = [np.array(inputs[name][k], dtype=float).reshape(-1) for name in inputs.dtype.names]
        shapes = [expected.dtype[name].shape for name in expected.dtype.names]
        out = [np.zeros(int(np.prod(shape, dtype=int))) for shape in shapes]
        before, after = ([ctypes.c_void_p(each.ctypes.data) for each in some] for some in ((work, *given, *read), out))
        call(*before, ctypes.c_double(k == RESET), *after)
        for name, value, shape in zip(expected.dtype.names, out, shapes, strict=True):
            found[name][k] = value.reshape(shape)
    compare(found, expected)


ROS2 = """
#include "src/controller.cpp"
#include <cstdio>
#include <fstream>

#define REQUIRE(x) do { if (!(x)) { std::printf("line %d: %s\\n", __LINE__, #x); return 1; } } while (0)

int main()
{
    using controller_interface::CallbackReturn;
    const auto c = make<controller_interface::ControllerInterface>();
    const auto node = c->get_node();
    double state[4], effort[2], brake;
    REQUIRE(c->on_init() == CallbackReturn::SUCCESS);
    node->known["brake_interface"].text = "brake/engaged";
    node->known["kp"].numbers[1] = -1.0;
    REQUIRE(c->on_configure({}) == CallbackReturn::ERROR && std::string(node->said).find("kp[1] is") == 0);
    node->known["kp"].numbers = {150.0, 150.0};
    node->known["threshold"].numbers = {25.0, 25.0};
    REQUIRE(c->on_configure({}) == CallbackReturn::SUCCESS);
    REQUIRE(c->state_interface_configuration().names[3] == "elbow/velocity");
    REQUIRE(c->command_interface_configuration().names.back() == "brake/engaged");
    for (double &each : state) c->state_interfaces_.push_back({&each});
    for (double &each : effort) c->command_interfaces_.push_back({&each});
    c->command_interfaces_.push_back({&brake});

    const std::map<int, const char *> modes = {MODES};
    std::ifstream rows("inputs.txt");
    std::FILE *found = std::fopen("outputs.txt", "w");
    for (int k = 0; k < TICKS; k++) {
        std::vector<double> row(COLUMNS);
        for (double &each : row) {
            std::string word;
            rows >> word;
            each = std::stod(word);
        }
        for (int j = 0; j < 2; j++) {
            state[2 * j] = row[j];
            state[2 * j + 1] = row[2 + j];
        }
        if (k == 0) REQUIRE(c->on_activate({}) == CallbackReturn::SUCCESS);
        const int mode = static_cast<int>(row.back());
        node->publish("~/mode", std_msgs::msg::String{modes.at(mode)});
        node->publish("~/reference", std_msgs::msg::Float64MultiArray{{row.begin() + 4, row.end() - 3}});
        const auto result = c->update({}, {row[row.size() - 3]});
        REQUIRE((brake != 0.0) == (result == controller_interface::return_type::ERROR));
        std::fprintf(found, "%.17g %.17g %.17g\\n", effort[0], effort[1], brake);
    }
    std::fclose(found);
    c->on_deactivate({});
    REQUIRE(effort[0] == 0.0 && brake == 1.0);

    /* until a reference arrives the arm stays where it is, in joints and at the tip */
    double torques[2][2];
    for (const int mode : {IMPEDANCE, GRAVITY}) {
        node->publish("~/mode", std_msgs::msg::String{modes.at(mode)});
        node->publish("~/reference", std_msgs::msg::Float64MultiArray{std::vector<double>(COLUMNS - 7, 9.0)});
        state[0] = 0.3, state[2] = -0.8, state[1] = state[3] = 0.0;
        REQUIRE(c->on_activate({}) == CallbackReturn::SUCCESS);
        (void)c->update({}, {0.001});
        std::copy(effort, effort + 2, torques[mode == GRAVITY]);
    }
    for (int j = 0; j < 2; j++) REQUIRE(std::abs(torques[0][j] - torques[1][j]) < 1e-9);
    return 0;
}
"""


def test_ros2_control(reference, tmp_path):
    """Through the base class, with stand-ins of the interfaces; a reset is an activation there."""
    inputs, _ = reference
    inputs = inputs[:240].copy()
    inputs["sample"] = np.arange(1, 241)
    inputs["mode"][160] = inputs["mode"][159]  # a mode is known by its name, others are not taken
    c = compiled_controller(arm(), "double", None, None, None, dict(SET))
    c.start(q=inputs["q"][0], dq=inputs["dq"][0])
    expected = c.run({name: inputs[name] for name in inputs.dtype.names})
    folder = exported("ros2", tmp_path)
    np.savetxt(folder / "inputs.txt", flat(inputs), "%.17g")
    words = ", ".join(f'{{{number}, "{name}"}}' for name, number in c.description["modes"].items())
    numbers = {name.upper(): str(number) for name, number in c.description["modes"].items()}
    text = ROS2.replace("IMPEDANCE", numbers["IMPEDANCE"]).replace("GRAVITY", numbers["GRAVITY"])
    text = text.replace("MODES", words).replace("TICKS", "240").replace("COLUMNS", str(flat(inputs).shape[1]))
    (folder / "use.cpp").write_text(text, encoding="utf-8")
    sources = ["arm.c", *OF_UNIT]
    run("gcc", "-std=c99", "-O1", "-ffp-contract=off", "-c", *sources, cwd=folder / "model")
    objects = [f"model/{name[:-1]}o" for name in sources]
    warnings = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    run(
        "g++", "-std=c++17", *warnings, f"-I{STAND_INS}", "-Imodel", "use.cpp", *objects, "-lm", "-o", "use", cwd=folder
    )
    run(folder / "use", cwd=folder)
    found = np.loadtxt(folder / "outputs.txt")
    np.testing.assert_array_equal(found[:, :2], expected["tau"])
    np.testing.assert_array_equal(found[:, 2], expected["brake"])
    assert expected["brake"].any()
    yaml = pytest.importorskip("ruamel.yaml").YAML(typ="safe")
    config = yaml.load((folder / "config" / "controller.yaml").read_text())["arm_controller"]["ros__parameters"]
    defaults = compiled_controller(arm(), "double", None, None, None, {}).params
    for name in defaults.data.dtype.names[2:]:
        np.testing.assert_array_equal(config[name], getattr(defaults, name))
    assert (folder / "urdf" / "arm.urdf").is_file()
    compile((folder / "launch" / "controller.launch.py").read_text(), "launch", "exec")


LOADED = """
#include <cstdio>
#include <class_loader/class_loader.hpp>
#include <controller_interface/controller_interface.hpp>

int main(int, char **arguments)
{
    using Interface = controller_interface::ControllerInterface;
    class_loader::ClassLoader loader(arguments[1]);
    const auto names = loader.getAvailableClasses<Interface>();
    const auto made = loader.createUniqueInstance<Interface>(names.at(0));
    std::printf("%d %s\\n", int(names.size()), names.at(0).c_str());
    return made->on_init() == controller_interface::CallbackReturn::SUCCESS ? 0 : 1;
}
"""


def of_ros2(header: str) -> Path | None:
    """The prefix that has a header of a package of ROS 2: one that a sourced ROS 2 names, or /usr."""
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(":"), "/usr"]
    return next((Path(p) for p in prefixes if p and (Path(p) / "include" / header).is_file()), None)


def test_the_loader_of_ros2_finds_the_controller(tmp_path):
    """With pluginlib and class_loader as they are; of the rest of ROS 2 there are stand-ins."""
    prefix = of_ros2("pluginlib/pluginlib/class_list_macros.hpp")
    if prefix is None or of_ros2("class_loader/class_loader/class_loader.hpp") != prefix:
        pytest.skip("needs pluginlib of ROS 2 (Debian: pluginlib-dev)")
    folder = exported("ros2", tmp_path)
    (folder / "use.cpp").write_text(LOADED, encoding="utf-8")
    found = [f"-isystem{path}" for path in (prefix / "include", *(prefix / "include").glob("*/"))]
    libraries = [path.parent for path in (prefix / "lib").rglob("libclass_loader.so")]
    link = [f"{option}{path}" for path in libraries for option in ("-L", "-Wl,-rpath,")]
    options = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fPIC", "-Imodel", *found, f"-isystem{STAND_INS}"]
    sources = ["arm.c", *OF_UNIT]
    run("gcc", "-std=c99", "-O0", "-fPIC", "-c", *(f"model/{source}" for source in sources), cwd=folder)
    objects = [f"{source[:-1]}o" for source in sources]
    run("g++", *options, "-shared", "src/controller.cpp", *objects, "-o", "libarm_controller.so", cwd=folder)
    run("g++", *options, "use.cpp", *link, "-lclass_loader", "-lconsole_bridge", "-ldl", "-o", "use", cwd=folder)
    assert run(folder / "use", folder / "libarm_controller.so", cwd=folder) == "1 arm_ros::Controller\n"
    plugin = (folder / "controller_plugin.xml").read_text(encoding="utf-8")
    assert 'type="arm_ros::Controller"' in plugin


CARGO = shutil.which("cargo") or shutil.which("cargo", path=Path.home() / ".cargo" / "bin")

RUST = """
use arm_controller::{mode, status, Controller, Input, Output, Params};
use std::{fs, mem::size_of};

fn main() {
    let mut params = Params::default();
    params.kp = [150.0; 2];
    params.threshold = [25.0; 2];
    params.dq_max[1] = -1.0;
    assert_eq!(Controller::new(&params, &Input::default()).err().unwrap().to_string(), "dq_max[1]");
    params.dq_max = Params::default().dq_max;
    let rows = fs::read("inputs").unwrap();
    let read = |row: &[u8]| unsafe { std::ptr::read_unaligned(row.as_ptr() as *const Input) };
    let inputs: Vec<Input> = rows.chunks(size_of::<Input>()).map(read).collect();
    let mut c = Controller::new(&params, &Input { q: inputs[0].q, dq: inputs[0].dq, ..Input::default() }).unwrap();
    let mut found = Vec::new();
    for (k, input) in inputs.iter().enumerate() {
        if k == 245 {
            c.reset(&inputs[244]).unwrap();
        }
        let out = c.step(input);
        assert!(k != 160 || out.status & status::MODE != 0 && out.mode != mode::FREE + 99);
        let bytes = &out as *const Output as *const u8;
        found.extend_from_slice(unsafe { std::slice::from_raw_parts(bytes, size_of::<Output>()) });
    }
    fs::write("outputs", found).unwrap();
}
"""


@pytest.mark.skipif(CARGO is None, reason="cargo is not installed")
def test_rust(reference, tmp_path):
    inputs, outputs = reference
    model = derived_model(arm(), GROUPS)[0]
    unit = unit_of(model)
    crate = tmp_path / "use"
    for name, text in (standalone_files(unit, "double") | rust_files(unit, "double")).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    (crate / "src").mkdir(parents=True)
    (crate / "src" / "main.rs").write_text(RUST, encoding="utf-8")
    depends = '[package]\nname = "use"\nversion = "0.1.0"\nedition = "2018"\n[dependencies]\n'
    (crate / "Cargo.toml").write_text(depends + 'arm_controller = { path = "../rust_controller" }\n', encoding="utf-8")
    (crate / "inputs").write_bytes(inputs.tobytes())
    command = f"PATH={Path(CARGO).parent}:$PATH RUSTFLAGS='-D warnings' cargo run -q --offline"
    run("sh", "-c", command, cwd=crate)
    compare(np.frombuffer((crate / "outputs").read_bytes(), outputs.dtype), outputs)


def test_fmu(reference, tmp_path):
    """A tick is a step of the co-simulation, which counts the samples; the reset is an input."""
    pytest.importorskip("fmpy", reason="needs FMPy to load an FMU")
    from fmpy.validation import validate_fmu

    from emit.targets.fmu_slave import Slave

    inputs, _ = reference
    inputs = inputs.copy()
    inputs["sample"], inputs["dt"] = np.arange(1, TICKS + 1), 1e-3
    expected = reset_with_its_tick(compiled_controller(arm(), "double", None, None, None, dict(SET)), inputs)
    fmu = exported("fmu", tmp_path) / "arm_controller.fmu"
    assert validate_fmu(str(fmu)) == []
    slave = Slave(fmu, tmp_path / "unzipped")
    run("gcc", "-std=c99", *STRICT, "-fsyntax-only", "arm_controller_fmu.c", cwd=slave.folder / "sources")
    known = slave.known
    assert (known["params.kp[1]"].unit, known["params.kp[1]"].min) == ("1/s2", "0.0")
    assert known["params.threshold[1]"].start == "INF"

    def read(row: np.ndarray) -> None:
        for name in inputs.dtype.names:
            for k, value in enumerate(np.ravel(row[name])):
                label = f"in.{name}[{k + 1}]" if row[name].shape else f"in.{name}"
                if label in known:
                    slave[label] = value

    for name, value in SET.items():
        for k in (1, 2):
            slave[f"params.{name}[{k}]"] = value
    read(inputs[0])
    slave.start()
    outputs = [name for name, v in known.items() if v.causality == "output"]
    found = []
    for k, row in enumerate(inputs):
        read(row)
        slave["reset"] = k == RESET
        slave.step()
        found.append(slave.all(outputs))
    compare(unflat(np.array(found), expected.dtype), expected)
    slave["params.kp[1]"] = -1.0
    with pytest.raises(Exception, match="fmi2"):
        slave.step()
    assert slave.said == ["kp[0]"]
    slave.end()


FILTERED = {"modes": ("computed_torque",), "parts": ("kalman", "observer", "any_gravity")}
LEAST = {"modes": ("free",), "parts": ()}


@pytest.mark.parametrize(
    ("target", "chosen"),
    [
        ("wheel", FILTERED),
        ("fmu", FILTERED),
        ("fmu", LEAST),
        ("matlab", LEAST),
        ("ros2", FILTERED),
        ("embedded", LEAST),
    ],
    ids=["wheel", "fmu", "fmu-least", "matlab-least", "ros2", "embedded-least"],
)
@pytest.mark.sweep(but=["fmu-least", "matlab-least"])
def test_packages_take_a_choice_of_modes_and_parts(target, chosen, tmp_path):
    """They compile without what is left out: joint speeds, if a filter computes them, and references of other modes."""
    folder = exported(target, tmp_path, chosen=chosen)
    if target == "fmu":  # its library is compiled where it is written
        with zipfile.ZipFile(folder / "arm_controller.fmu") as archive:
            description = archive.read("modelDescription.xml").decode()
        assert ('name="in.dq[1]"' in description) == ("kalman" not in chosen["parts"])
        assert ('name="params.gravity[1]"' in description) == ("any_gravity" in chosen["parts"])
        return
    if target == "wheel":
        (wheel,) = folder.glob("*.whl")
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder / "site")
        text = "import sys; sys.path.insert(0, sys.argv[1]); import arm_model as robot; c = robot.Controller('gravity')"
        text += "; c.start(q=[0.3, 0.2]); print(*c.modes, c.step(q=[0.3, 0.2]).status, c.description['parts'])"
        modes = dict.fromkeys(("free", "gravity", *chosen["modes"]))
        said = run(sys.executable, "-I", "-c", text, folder / "site")
        assert said.startswith(" ".join(modes))
        assert all(part in said for part in chosen["parts"])
        return
    for source in [*folder.glob("src/*.c"), *folder.glob("model/*.c")]:
        if not source.name.endswith("_mex.c"):
            run("gcc", "-std=c99", *STRICT, "-fsyntax-only", source)
    if target == "ros2":
        run(
            "g++",
            "-std=c++17",
            *STRICT[:3],
            "-fsyntax-only",
            f"-I{STAND_INS}",
            "-Imodel",
            "src/controller.cpp",
            cwd=folder,
        )
    if target == "embedded":
        check_sketch(folder, "controller")
        check_sample(folder)


def test_a_choice_without_the_controller_is_refused():
    from rrrgen.base.errors import InputError

    for target, further in (("wheel", ()), ("wheel", ("control",)), ("urdf", ())):
        with pytest.raises(InputError, match="--modes and --parts belong to --with controller"):
            export_robot(arm(), target, options=ExportOptions(further=further, chosen={"modes": ("gravity",)}))
    with pytest.raises(InputError, match="exclude each other"):
        export_robot(
            arm(), "fmu", options=ExportOptions(further=("controller",), chosen={"parts": ("kalman", "differences")})
        )
