"""Random faults through every socket: ``python -m tests.emit.targets.socket_fuzz --ticks 1000000 [--target rust ..]``.

Each socket gets the same inputs as the unit in Python, with wild numbers in any field, changes of mode and resets, and
its outputs must be the same bits; the unit itself is judged by ``tests.controller.fault_table``. So nothing that is not
finite leaves a socket, its status is right and it recovers. Undefined behaviour in C and C++ is fatal, and so is
a panic of Rust. What only a socket has is damaged too: parameters, value references and states of the FMU, names and
sizes in MATLAB, signals of Simulink that are no integers, parameters of ROS 2, time and watchdog of the boards.
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from rrrgen.controller.files import derived_unit, rust_files, standalone_files
from rrrgen.controller.python_class import Controller
from rrrgen.emit import Real
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.runtime.controller import compiled_controller

from .arm import arm
from .rrr_library import run

HERE = Path(__file__).parent
BATCH = 250_000
"""Ticks of one program; more are several programs with seeds of their own."""

SOUND = 10**6
"""A seed whose first row has no fault: a socket starts there."""

SET = {"kp": 150.0, "threshold": 25.0}
UNDEFINED = ("-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover=all")
TRAPPED = "-fsanitize=undefined,float-cast-overflow -fsanitize-undefined-trap-on-error"
C = ("gcc", "-std=c99", "-O1", "-ffp-contract=off", *UNDEFINED)
CPP = ("g++", "-std=c++17", "-O1", "-ffp-contract=off", *UNDEFINED, "-Wall", "-Wextra", "-Werror")
CARGO = shutil.which("cargo") or shutil.which("cargo", path=Path.home() / ".cargo" / "bin")


def random_inputs(kind: np.dtype[Any], modes: list[int], ticks: int, seed: int) -> np.ndarray:
    """A motion in all modes by turns, in which every eighth row has wild numbers."""
    random = np.random.default_rng(seed)
    rows, t = np.zeros(ticks, kind), np.arange(ticks)[:, None] * 1e-3
    w = np.array([2.0, 3.0])
    rows["q"], rows["dq"] = [0.3, -0.8] + 0.2 * np.sin(w * t), 0.2 * w * np.cos(w * t)
    rows["q_d"], rows["dq_d"] = rows["q"] + 0.01, rows["dq"]
    rows["T_d"], rows["V_d"] = np.eye(4).ravel(), [0.1, 0.05, 0.0, 0.0, 0.0, 0.2]
    rows["dt"], rows["sample"] = 1e-3, np.arange(1, ticks + 1)
    rows["mode"] = np.repeat(random.choice(modes, ticks // 64 + 1), 64)[:ticks]
    largest = float(np.finfo(kind["q"].base).max)
    wild = np.array([np.nan, np.inf, -np.inf, largest, -largest, largest * 1e-8, 1e20, -1e10, 1e-40, 0.0, 1.0])
    fields = [name for name in kind.names or () if kind[name].base.kind == "f"]
    for _ in range(2):
        for k in np.flatnonzero(random.random(ticks) < 1 / 16):
            name = fields[random.integers(len(fields))]
            at = (k, random.integers(kind[name].shape[0])) if kind[name].shape else k
            rows[name][at] = random.choice(wild)
    unchanged = np.flatnonzero(random.random(ticks) < 0.02)
    rows["sample"][unchanged] -= 1
    unknown = np.flatnonzero(random.random(ticks) < 0.02)
    rows["mode"][unknown] = random.integers(-16, 48, len(unknown))
    return rows


def expected(
    controller: Controller, rows: np.ndarray, seed: int, restart: bool, retries: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Outputs of the unit, and the ticks before which it was reset, or started again if ``restart``."""
    random = np.random.default_rng(seed + 1)
    chance = random.random(len(rows)) < 1 / 32
    outputs, resets = np.zeros(len(rows), controller._output.data.dtype), np.zeros(len(rows), bool)
    state, source, sink = controller._state.ctypes.data, rows.ctypes.data, outputs.ctypes.data
    started = latched = False
    for k in range(len(rows)):
        resets[k] = k > 0 and latched and chance[k] and not resets[k - 1]
        if k == 0 or (restart and resets[k]) or (retries and not started):
            if retries:  # whose first tick is never stale
                controller._input.sample = (int(rows["sample"][k]) - 1) % 2**32
            try:
                controller.start(q=rows["q"][k], dq=rows["dq"][k])
                started = True
            except ValueError:
                started = False
        elif resets[k]:
            controller._call("reset", state, source + k * rows.itemsize)
        controller._input.data[...] = rows[k]
        controller._call("step", state, source + k * rows.itemsize, sink + k * outputs.itemsize)
        latched = bool(outputs["phase"][k] >= 2 or not started)
    return outputs, resets


def flat(rows: np.ndarray) -> np.ndarray:
    """Every field of the rows as columns (ticks, columns), in double."""
    return np.hstack([rows[name].reshape(len(rows), -1).astype(float) for name in rows.dtype.names or ()])


def column(rows: np.ndarray, field: str) -> int:
    """The number of the first column of a field."""
    names = rows.dtype.names or ()
    return sum(int(np.prod(rows.dtype[name].shape, dtype=int)) for name in names[: names.index(field)])


def package(target: str, place: Path, real: Real = "double") -> Path:
    options = ExportOptions(real=real, further=("controller",))
    for name, contents in export_robot(arm(), target, options=options).files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    return place


def taken(rows: np.ndarray, to: str = "in.", leave: tuple[str, ...] = (), real: str = "double") -> str:
    """C that fills the struct ``to`` from the numbers of ``row``, field by field."""
    lines, at = [], 0
    for name in rows.dtype.names or ():
        kind, shape = rows.dtype[name].base, rows.dtype[name].shape
        cast = {"f": f"({real})", "i": "(int32_t)", "u": "(uint32_t)"}[kind.kind]
        for k in range(shape[0] if shape else 1):
            if name not in leave:
                lines.append(f"{to}{name}{f'[{k}]' if shape else ''} = {cast}row[{at}];")
            at += 1
    return "\n".join(lines)


READER = """
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#define COLUMNS {columns}
#define REQUIRE(x) do {{ if (!(x)) {{ printf("line %d, tick %ld: %s\\n", __LINE__, tick, #x); exit(1); }} }} while (0)
static double row[COLUMNS + 1]; /* the input field by field, then whether to reset */
static long tick = -1;
static FILE *inputs, *outputs;
static int next(void)
{{
    if (inputs == NULL) {{
        inputs = fopen("inputs", "rb");
        outputs = fopen("outputs", "wb");
    }}
    tick++;
    return fread(row, sizeof(row), 1, inputs) == 1;
}}
"""


@dataclass(frozen=True)
class Run:
    """What a socket is run on: its folder, the inputs, which rows ask for a reset, and the unit that they are for."""

    folder: Path
    rows: np.ndarray
    resets: np.ndarray
    outputs: np.ndarray
    controller: Controller

    @property
    def reader(self) -> str:
        """C that reads the inputs from the file that this writes."""
        columns = np.hstack([flat(self.rows), self.resets[:, None]])
        (self.folder / "inputs").write_bytes(columns.astype(float).tobytes())
        return READER.format(columns=columns.shape[1] - 1)

    def found(self) -> np.ndarray:
        """The outputs that a program has written."""
        return np.frombuffer((self.folder / "outputs").read_bytes(), self.outputs.dtype)

    def program(self, text: str, compiler: tuple[str, ...], *options: object, suffix: str = ".c") -> np.ndarray:
        """Compile and run a program of the socket."""
        (self.folder / f"use{suffix}").write_text(text, encoding="utf-8")
        run(*compiler, *options, "-lm", "-o", "use", cwd=self.folder)
        run("./use", cwd=self.folder, timeout=600)
        return self.found()


def in_c(r: Run) -> np.ndarray:
    """A program in C around the unit alone."""
    files = standalone_files(derived_unit(arm()), "double")
    for name, text in files.items():
        (r.folder / name).write_text(text, encoding="utf-8")
    text = f"""{r.reader}
#include "arm_controller.h"
int main(void)
{{
    arm_controller_params params;
    arm_controller_state state;
    arm_controller_input in;
    arm_controller_output out;
    arm_controller_default(&params);
    for (int k = 0; k < 2; k++) {{
        params.kp[k] = 150.0;
        params.threshold[k] = 25.0;
    }}
    while (next()) {{
        {taken(r.rows)}
        if (tick == 0) {{
            in.sample--;
            (void)arm_controller_init(&state, &params, &in);
            in.sample++;
        }}
        if (row[COLUMNS] != 0.0) (void)arm_controller_reset(&state, &in);
        arm_controller_step(&state, &in, &out);
        fwrite(&out, sizeof(out), 1, outputs);
    }}
    return fclose(outputs);
}}
"""
    return r.program(text, C, "use.c", *(name for name in files if name.endswith(".c")))


WHEEL = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from arm_model import Controller

inputs, resets = np.load("inputs.npy"), np.flatnonzero(np.load("resets.npy"))
names = inputs.dtype.names
c, found = Controller("gravity", kp=150.0, threshold=25.0), []
try:
    c.start(q=inputs["q"][0], dq=inputs["dq"][0])
except ValueError:
    pass
for first, last in zip([0, *resets], [*resets, len(inputs)]):
    if first:
        try:
            c.reset(**{name: inputs[name][first] for name in names})
        except ValueError:
            pass
    found.append(c.run({name: inputs[name][first:last] for name in names}))
    try:
        c.set(kp=float("nan"))
        raise SystemExit("a wrong parameter was taken")
    except ValueError:
        c.params.kp = 150.0
np.save("outputs.npy", np.concatenate(found))
"""


def wheel(r: Run) -> np.ndarray:
    """The class of the wheel."""
    (archive,) = package("wheel", r.folder).glob("*.whl")
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(r.folder / "site")
    np.save(r.folder / "inputs.npy", r.rows)
    np.save(r.folder / "resets.npy", r.resets)
    run(sys.executable, "-I", "-c", WHEEL, r.folder / "site", cwd=r.folder, timeout=600)
    return np.load(r.folder / "outputs.npy")


RUST = """
use arm_controller::{Controller, Input, Output, Params};
use std::{fs, io::Write, mem::size_of};

fn main() {
    let mut params = Params::default();
    params.kp = [150.0; 2];
    params.threshold = [25.0; 2];
    let (rows, resets) = (fs::read("inputs").unwrap(), fs::read("resets").unwrap());
    let read = |row: &[u8]| unsafe { std::ptr::read_unaligned(row.as_ptr() as *const Input) };
    let inputs: Vec<Input> = rows.chunks(size_of::<Input>()).map(read).collect();
    let first = Input { sample: inputs[0].sample - 1, ..inputs[0] };
    let mut c = Controller::new(&params, &first).expect("the first readings are usable");
    let mut found = fs::File::create("outputs").unwrap();
    for (k, input) in inputs.iter().enumerate() {
        if resets[k] != 0 {
            let _ = c.reset(input).map_err(|wrong| wrong.to_string());
        }
        if k % 37 == 0 {
            let mut wrong = params;
            wrong.dq_max[k % 2] = Params::default().dq_max[0] * -1.0;
            assert_eq!(c.set(&wrong).unwrap_err().to_string(), format!("dq_max[{}]", k % 2));
        }
        let out = c.step(input);
        let bytes = unsafe { std::slice::from_raw_parts(&out as *const Output as *const u8, size_of::<Output>()) };
        found.write_all(bytes).unwrap();
    }
}
"""


def rust(r: Run) -> np.ndarray:
    """The crate, with checks of overflow, and its C where undefined behaviour traps."""
    unit, crate = derived_unit(arm()), r.folder / "use"
    (crate / "src").mkdir(parents=True)
    for name, text in (standalone_files(unit, "double") | rust_files(unit, "double")).items():
        (r.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (r.folder / name).write_text(text, encoding="utf-8")
    depends = '[dependencies]\narm_controller = { path = "../rust_controller" }\n'
    (crate / "Cargo.toml").write_text(f'[package]\nname = "use"\nversion = "0.1.0"\nedition = "2018"\n{depends}')
    (crate / "src" / "main.rs").write_text(RUST, encoding="utf-8")
    (crate / "inputs").write_bytes(r.rows.tobytes())
    (crate / "resets").write_bytes(r.resets.astype(np.uint8).tobytes())
    flags = f"PATH={Path(str(CARGO)).parent}:$PATH RUSTFLAGS='-D warnings' CFLAGS='{TRAPPED}'"
    run("sh", "-c", f"{flags} cargo run -q --offline", cwd=crate, timeout=600)
    shutil.move(crate / "outputs", r.folder / "outputs")
    return r.found()


def fmu(r: Run) -> np.ndarray:
    """The functions of FMI, called by a program that also gives them wrong parameters, references and states."""
    with zipfile.ZipFile(package("fmu", r.folder) / "arm_controller.fmu") as archive:
        archive.extractall(r.folder)
    names = re.findall(
        r'<ScalarVariable name="([^"]+)" valueReference', (r.folder / "modelDescription.xml").read_text()
    )
    given = {f"params.{name}[{k}]": value for name, value in SET.items() for k in (1, 2)}
    start = "\n".join(f"put({names.index(name)}, {value});" for name, value in given.items())
    columns, at = {}, 0
    for name in r.rows.dtype.names or ():
        size = int(np.prod(r.rows.dtype[name].shape, dtype=int))
        for k in range(size):
            columns[f"in.{name}" + (f"[{k + 1}]" if r.rows.dtype[name].shape else "")] = at + k
        at += size
    read = "\n".join(f"put({names.index(name)}, row[{k}]);" for name, k in columns.items() if name in names)
    text = f"""#include "sources/arm_controller_fmu.c"
{r.reader}
#include <math.h>
static fmi2Component c;
static void put(fmi2ValueReference vr, double value)
{{
    const fmi2Integer integer = variables[vr].integer ? (fmi2Integer)value : 0;
    REQUIRE((variables[vr].integer ? fmi2SetInteger(c, &vr, 1, &integer) : fmi2SetReal(c, &vr, 1, &value)) == fmi2OK);
}}
static void quiet(fmi2ComponentEnvironment e, fmi2String name, fmi2Status s, fmi2String kind, fmi2String text, ...)
{{
    (void)e, (void)name, (void)s, (void)kind, (void)text;
}}
int main(void)
{{
    const fmi2CallbackFunctions host = {{quiet, calloc, free, NULL, NULL}};
    const fmi2ValueReference reset = {names.index("reset")}, gain = {names.index("params.kp[2]")};
    const fmi2ValueReference output = OUT_FIRST, none = SIZE;
    while (next()) {{
        const double dt = row[{columns["in.dt"]}];
        if (tick == 0) {{
            REQUIRE((c = fmi2Instantiate("c", fmi2CoSimulation, GUID, "", &host, 0, 0)) != NULL);
            REQUIRE(fmi2DoStep(c, 0.0, 1e-3, 1) == fmi2Error);
            {start}
        }}
        {read}
        if (tick == 0) {{
            REQUIRE(fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) == fmi2OK && fmi2EnterInitializationMode(c) == fmi2OK);
            REQUIRE(fmi2ExitInitializationMode(c) == fmi2OK);
        }}
        put(reset, row[COLUMNS]);
        if (tick % 37 == 0) {{ /* a wrong parameter: an error, and no tick */
            fmi2FMUstate kept = NULL;
            REQUIRE(fmi2GetFMUstate(c, &kept) == fmi2OK);
            put(gain, (tick % 2) ? (double)NAN : -1e300);
            REQUIRE(fmi2DoStep(c, 0.0, dt, 1) == fmi2Error);
            REQUIRE(fmi2SetFMUstate(c, kept) == fmi2OK && fmi2FreeFMUstate(c, &kept) == fmi2OK);
        }}
        if (tick % 53 == 0) {{
            double real = 0.0;
            REQUIRE(fmi2SetReal(c, &output, 1, &real) == fmi2Error && fmi2SetReal(c, &reset, 1, &real) == fmi2Error);
            REQUIRE(fmi2GetReal(c, &none, 1, &real) == fmi2Error);
        }}
        if (tick % 101 == 0) {{ /* a step that is taken back */
            fmi2FMUstate kept = NULL, copy = NULL;
            static char bytes[1 << 16];
            size_t size;
            REQUIRE(fmi2GetFMUstate(c, &kept) == fmi2OK && fmi2SerializedFMUstateSize(c, kept, &size) == fmi2OK);
            REQUIRE(size <= sizeof(bytes) && fmi2SerializeFMUstate(c, kept, bytes, size) == fmi2OK);
            REQUIRE(fmi2DeSerializeFMUstate(c, bytes, size - 1, &copy) == fmi2Error);
            REQUIRE(fmi2DoStep(c, 0.0, 7.0 * dt, 1) == fmi2OK);
            REQUIRE(fmi2DeSerializeFMUstate(c, bytes, size, &copy) == fmi2OK && fmi2SetFMUstate(c, copy) == fmi2OK);
            REQUIRE(fmi2FreeFMUstate(c, &kept) == fmi2OK && fmi2FreeFMUstate(c, &copy) == fmi2OK);
        }}
        REQUIRE(fmi2DoStep(c, 1e-3 * (double)tick, dt, 1) == fmi2OK);
        for (fmi2ValueReference vr = OUT_FIRST; vr < SIZE; vr++) {{
            double real = 0.0;
            fmi2Integer number;
            if (variables[vr].integer) REQUIRE(fmi2GetInteger(c, &vr, 1, &number) == fmi2OK);
            else REQUIRE(fmi2GetReal(c, &vr, 1, &real) == fmi2OK && isfinite(real));
        }}
        fwrite(&((instance *)c)->out, sizeof(arm_controller_output), 1, outputs);
    }}
    REQUIRE(fmi2Terminate(c) == fmi2OK);
    fmi2FreeInstance(c);
    return fclose(outputs);
}}
"""
    sources = [f"sources/{each.name}" for each in (r.folder / "sources").glob("*.c") if "_fmu" not in each.name]
    return r.program(text, C, "-fsanitize=address", "-Isources", "use.c", *sources)


MEX = """1;
function refused(call, id)
  try
    call();
  catch err
    assert(err.identifier, id);
    return
  end
  error('nothing was refused');
end
params = arm.controller('default');
params.kp(:) = 150; params.threshold(:) = 25;
file = fopen('inputs'); rows = fread(file, [COLUMNS + 1, Inf], 'double')'; fclose(file);
names = {NAMES}; widths = [WIDTHS]; last = cumsum(widths);
found = fopen('numbers', 'w');
for k = 1:size(rows, 1)
  for f = 1:numel(names)
    in.(names{f}) = rows(k, last(f) - widths(f) + 1 : last(f))';
  end
  if k == 1
    state = arm.controller('init', params, struct('q', in.q, 'dq', in.dq));
  elseif rows(k, end)
    try
      state = arm.controller('reset', state, in);
    catch err
      assert(err.identifier, 'arm:parameter');
    end
  end
  if mod(k, 997) == 1
    wrong = in; wrong.mode = NaN;
    refused(@() arm.controller('step', state, wrong), 'arm:size');
    wrong = in; wrong.sample = 1e300;
    refused(@() arm.controller('step', state, wrong), 'arm:size');
    wrong = in; wrong.q = [0; 0; 0];
    refused(@() arm.controller('step', state, wrong), 'arm:size');
    refused(@() arm.controller('step', state(1:8), in), 'arm:type');
    wrong = params; wrong.kp(2) = -Inf;
    refused(@() arm.controller('set', state, wrong), 'arm:parameter');
  end
  [out, state] = arm.controller('step', state, in);
  fwrite(found, vertcat(struct2cell(out){:}), 'double');
end
fclose(found);
"""


def matlab(r: Run) -> np.ndarray:
    """The MEX function in Octave, whose C traps undefined behaviour."""
    folder = package("matlab", r.folder)
    names = r.rows.dtype.names or ()
    widths = [int(np.prod(r.rows.dtype[name].shape, dtype=int)) for name in names]
    words = {"COLUMNS": sum(widths), "NAMES": ", ".join(f"'{n}'" for n in names), "WIDTHS": " ".join(map(str, widths))}
    text, _ = MEX, r.reader
    for word, value in words.items():
        text = text.replace(word, str(value))
    (folder / "use.m").write_text(text, encoding="utf-8")
    flags = f"setenv('CFLAGS', '-O1 -ffp-contract=off {TRAPPED}')"
    run("octave-cli", "-q", "--eval", f"{flags}; build_arm; use", cwd=folder, timeout=600)
    numbers, found, at = np.fromfile(folder / "numbers").reshape(len(r.rows), -1), np.zeros_like(r.outputs), 0
    for name in found.dtype.names or ():
        size = int(np.prod(found.dtype[name].shape, dtype=int))
        found[name] = numbers[:, at : at + size].reshape(found[name].shape)
        at += size
    return found


NEWLINE = "\n"
KINDS = {"real": "double", "int32": "int32_t", "uint32": "uint32_t"}


def _numbers(values: Any) -> str:
    """Numbers in C."""
    return ", ".join(repr(float(x)).replace("inf", "INFINITY") for x in np.ravel(values))


def simulink(r: Run) -> np.ndarray:
    """The function of the block; where the mode is unknown, its signal is no integer at all."""
    source = package("matlab", r.folder) / "src"
    structs, numbers = r.controller.description["structs"], r.controller.params
    parameters, read, written = (structs[name]["fields"] for name in ("params", "input", "output"))
    given = [f"static const double p_{f['name']}[] = {{{_numbers(getattr(numbers, f['name']))}}};" for f in parameters]
    given += [f"static double y_{f['name']}[{f['count'] or 1}];" for f in written]
    keep = [
        f"out.{f['name']}{f'[{k}]' if f['count'] else ''} = ({KINDS[f['type']]})y_{f['name']}[{k}];"
        for f in written
        for k in range(f["count"] or 1)
    ]
    arguments = [f"p_{f['name']}" for f in parameters]
    arguments += [f"&row[{column(r.rows, f['name'])}]" for f in read] + ["row[COLUMNS]"]
    arguments += [f"y_{f['name']}" for f in written]
    size = (r.controller.description["state_size"] + structs["params"]["size"]) // 8 + 1
    text = f"""{r.reader}
#include <math.h>
#include "arm_controller.h"
#include "arm_simulink.h"
{NEWLINE.join(given)}
int main(void)
{{
    static double work[{size}];
    arm_controller_output out;
    while (next()) {{
        double *const mode = &row[COLUMNS - 1];
        if (*mode < 0.0 || *mode > 31.0) {{ /* unknown */
            *mode = (tick % 3 == 0) ? (double)NAN : (tick % 3 == 1) ? 1e300 : -INFINITY;
        }}
        arm_sl_controller(work, {", ".join(arguments)});
        {NEWLINE.join(keep)}
        fwrite(&out, sizeof(out), 1, outputs);
    }}
    return fclose(outputs);
}}
"""
    (source / "use.c").write_text(text, encoding="utf-8")
    sources = [f"src/{each.name}" for each in source.glob("*.c") if not re.search("_mex|_calls", each.name)]
    run(*C, "-Isrc", *sources, "-lm", "-o", "use", cwd=r.folder)
    run("./use", cwd=r.folder, timeout=600)
    return r.found()


def _filled(text: str, fills: dict[str, str]) -> str:
    """A sketch with the bodies of the functions that its user writes."""
    for name, body in fills.items():
        text, count = re.subn(
            rf"(static \w+ {name}\([^)]*\)\n{{\n).*?\n?}}\n", rf"\g<1>{body}\n}}\n", text, flags=re.DOTALL
        )
        assert count == 1, name
    return text


BOARD = {"read_arm": "    return board_read(q, dq);", "next_reference": "    board_reference(reference);"}


def _board(r: Run) -> str:
    """What the sketches read: a sample is new where its counter has changed."""
    sample = column(r.rows, "sample")
    return f"""
#include "arm_controller.h"
static int starting; /* the readings of the start are those of the first tick */
static int board_read(float *q, float *dq)
{{
    static double last = 0.0;
    const int fresh = row[{sample}] > last;
    q[0] = (float)row[0], q[1] = (float)row[1], dq[0] = (float)row[2], dq[1] = (float)row[3];
    last = (fresh && !starting) ? row[{sample}] : last;
    return fresh;
}}
static void board_reference(arm_controller_input *reference)
{{
    {taken(r.rows, "reference->", ("q", "dq", "dt", "sample"), "float")}
}}
static void tune(arm_controller_params *p)
{{
    for (int k = 0; k < 2; k++) {{
        p->kp[k] = 150.0f;
        p->threshold[k] = 25.0f;
    }}
}}
"""


def _tuned(text: str) -> str:
    return text.replace("arm_controller_default(&params);", "arm_controller_default(&params);\n    tune(&params);")


def _objects(r: Run, folder: str) -> list[str]:
    """Compile what the controller calls of the C of a package."""
    objects = []
    for source in sorted((r.folder / folder).glob("arm*.c")):
        if not re.search("derivatives|nominal|_ik.c", source.name) or "differential_ik" in source.name:
            objects.append(f"{source.stem}.o")
            run(*C, "-c", f"{folder}/{source.name}", "-o", objects[-1], cwd=r.folder)
    return objects


def arduino(r: Run) -> np.ndarray:
    """The sketch, with a clock that overflows; a reset is a new start of the board."""
    sketch = package("embedded", r.folder, "float") / "examples" / "controller" / "controller.ino"
    at = column(r.rows, "dt")
    fills = BOARD | {"write_arm": "    (void)tau;\n    braked = brake;", "feed_watchdog": "    fed++;"}
    sketch.write_text(_filled(_tuned(sketch.read_text()), fills), encoding="utf-8")
    text = f"""{r.reader}{_board(r)}
#include "Arduino.h"
#include <cmath>
static uint32_t clock_of_board = 0xFFFFF000u;
static long fed;
static bool braked;
#define micros() clock_of_board
#define long int /* 32 bits, as on the boards */
#include "examples/controller/controller.ino"
#undef long
int main()
{{
    while (next()) {{
        starting = tick == 0 || row[COLUMNS] != 0.0;
        if (starting) setup();
        starting = 0;
        clock_of_board += 500u;
        loop();
        REQUIRE(fed == tick); /* it is not time yet */
        clock_of_board += (uint32_t)(row[{at}] * 1e6 + 0.5) - 500u;
        loop();
        REQUIRE(fed == tick + 1 && braked == (out.brake != 0));
        fwrite(&out, sizeof(out), 1, outputs);
    }}
    return fclose(outputs);
}}
"""
    options = ("-Wno-unused-function", f"-I{HERE / 'board_stand_ins'}", "-Isrc")
    return r.program(text, CPP, *options, "use.cpp", *_objects(r, "src"), suffix=".cpp")


def zephyr(r: Run) -> np.ndarray:
    """The sample, whose timer and watchdog are those of the program; a reset is a new start of the board."""
    sample = package("embedded", r.folder, "float") / "zephyr" / "samples" / "controller" / "src" / "main.c"
    at = column(r.rows, "dt")
    fills = BOARD | {"write_arm": "    (void)tau;\n    braked = brake;"}
    sample.write_text(_filled(_tuned(sample.read_text()), fills), encoding="utf-8")
    text = f"""{r.reader}{_board(r)}
#include <math.h>
#include <setjmp.h>
static jmp_buf again;
static uint32_t cycles = 0xFFFFF000u;
static long fed;
static int braked, pending;
#define main sample_main
#include "zephyr/samples/controller/src/main.c"
#undef main
const struct device watchdog0 = {{1}};
void k_timer_start(struct k_timer *timer, int duration, int length)
{{
    (void)timer, (void)duration, (void)length, starting = 0;
}}
uint32_t k_cycle_get_32(void) {{ return cycles; }}
uint64_t k_cyc_to_ns_floor64(uint64_t count) {{ return 10u * count; }}
int wdt_install_timeout(const struct device *dev, const struct wdt_timeout_cfg *cfg)
{{
    return (dev->ready == 1 && cfg->window.max > 0u) ? 0 : -1;
}}
int wdt_setup(const struct device *dev, uint8_t options) {{ return dev->ready + options; }}
int wdt_feed(const struct device *dev, int channel_id) {{ fed++; return dev->ready + channel_id; }}
void printk(const char *text, ...) {{ (void)text; }}
uint32_t k_timer_status_sync(struct k_timer *timer)
{{
    (void)timer;
    if (pending == 0) {{
        REQUIRE(fed == tick + 1 && braked == out.brake);
        fwrite(&out, sizeof(out), 1, outputs);
        if (!next()) exit(fclose(outputs));
        pending = 1;
        if (row[COLUMNS] != 0.0) longjmp(again, 1);
    }}
    pending = 0;
    cycles += (uint32_t)(row[{at}] * 1e8 + 0.5);
    return 1u;
}}
int main(void)
{{
    pending = next();
    (void)setjmp(again);
    starting = 1;
    return sample_main();
}}
"""
    return r.program(
        text, C, "-Wno-unused-function", f"-I{HERE / 'board_stand_ins'}", "-Isrc", "use.c", *_objects(r, "src")
    )


def ros2(r: Run) -> np.ndarray:
    """The controller of ros2_control with stand-ins of its interfaces; a reset is a new activation."""
    package("ros2", r.folder)
    modes = ", ".join(f'{{{number}, "{name}"}}' for name, number in r.controller.description["modes"].items())
    dt, wanted = column(r.rows, "dt"), column(r.rows, "mode")
    text = f"""{r.reader}
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <controller_interface/controller_interface.hpp>
#define private public
#include "src/controller.cpp"
#undef private
using controller_interface::CallbackReturn;
int main()
{{
    arm_ros::Controller c;
    const auto node = c.get_node();
    double state[4], effort[2], brake;
    const std::map<int, const char *> modes = {{{modes}}};
    REQUIRE(c.on_init() == CallbackReturn::SUCCESS);
    node->known["brake_interface"].text = "brake/engaged";
    node->known["kp"].numbers = {{150.0, 150.0}};
    node->known["threshold"].numbers = {{25.0, 25.0}};
    for (const auto &field : arm_controller_fields) {{
        const auto kept = node->known[field.name];
        for (const double wrong : {{std::nan(""), -1e300, 1e300}}) {{
            if (field.integer) node->known[field.name].integer = wrong > 0.0 ? INT64_MAX : INT64_MIN;
            else node->known[field.name].numbers[0] = wrong;
            REQUIRE(c.on_configure({{}}) == CallbackReturn::ERROR && std::string(node->said).find(field.name) == 0);
        }}
        if (!field.integer) {{
            node->known[field.name].numbers.push_back(1.0);
            REQUIRE(field.count == 1 || c.on_configure({{}}) == CallbackReturn::ERROR);
        }}
        node->known[field.name] = kept;
    }}
    REQUIRE(c.on_configure({{}}) == CallbackReturn::SUCCESS);
    for (double &each : state) c.state_interfaces_.push_back({{&each}});
    for (double &each : effort) c.command_interfaces_.push_back({{&each}});
    c.command_interfaces_.push_back({{&brake}});
    while (next()) {{
        for (int j = 0; j < 2; j++) state[2 * j] = row[j], state[2 * j + 1] = row[2 + j];
        if (row[COLUMNS] != 0.0) {{
            REQUIRE(c.on_deactivate({{}}) == CallbackReturn::SUCCESS);
            REQUIRE(effort[0] == 0.0 && effort[1] == 0.0 && brake == 1.0);
        }}
        if (tick == 0 || row[COLUMNS] != 0.0) (void)c.on_activate({{}});
        const int mode = static_cast<int>(row[{wanted}]);
        node->publish("~/mode", std_msgs::msg::String{{modes.count(mode) ? modes.at(mode) : "nonsense"}});
        node->publish("~/reference", std_msgs::msg::Float64MultiArray{{{{1.0, 2.0}}}}); /* another size is not taken */
        node->publish("~/reference", std_msgs::msg::Float64MultiArray{{{{row + 4, row + {dt}}}}});
        const auto result = c.update({{}}, {{row[{dt}]}});
        REQUIRE((brake != 0.0) == (result == controller_interface::return_type::ERROR));
        REQUIRE(effort[0] == c.out_.tau[0] && effort[1] == c.out_.tau[1]);
        fwrite(&c.out_, sizeof(c.out_), 1, outputs);
    }}
    return fclose(outputs);
}}
"""
    objects = _objects(r, "model")
    return r.program(text, CPP, f"-I{HERE / 'ros2_stand_ins'}", "-Imodel", "-I.", "use.cpp", *objects, suffix=".cpp")


@dataclass(frozen=True)
class Socket:
    """A socket: how it is run, its number type, what it counts or cannot be given, and the tool that it needs.

    ``counts``: the socket counts the samples itself; ``clock``: it measures the period itself, in microseconds;
    ``known``: other modes are not taken. ``restart``: a reset is a start; ``retries``: it tries again where one failed.
    """

    run: Callable[[Run], np.ndarray]
    real: Real = "double"
    counts: bool = False
    clock: bool = False
    known: bool = False
    restart: bool = False
    retries: bool = False
    missing: str = ""


SOCKETS = {
    "c": Socket(in_c),
    "wheel": Socket(wheel),
    "rust": Socket(rust, missing="" if CARGO else "cargo"),
    "fmu": Socket(fmu, counts=True),
    "mex": Socket(matlab, missing="" if shutil.which("mkoctfile") else "Octave and its headers (octave-dev)"),
    "simulink": Socket(simulink, retries=True),
    "arduino": Socket(arduino, "float", clock=True, restart=True),
    "zephyr": Socket(zephyr, "float", clock=True, restart=True),
    "ros2": Socket(ros2, counts=True, known=True, restart=True),
}


def adapted(socket: Socket, rows: np.ndarray, modes: list[int]) -> np.ndarray:
    """The rows that the unit sees behind a socket."""
    rows = rows.copy()
    if socket.counts:
        rows["sample"] = np.arange(1, len(rows) + 1)
    if socket.clock:
        random = np.random.default_rng(len(rows))
        periods = np.where(random.random(len(rows)) < 0.02, random.integers(1000, 50_000, len(rows)), 1000)
        unit, count = (np.float32(1e-9), 1000 * periods) if socket.run is zephyr else (np.float32(1e-6), periods)
        rows["dt"] = unit * count.astype(np.float32)
        fresh = np.diff(np.maximum.accumulate(rows["sample"]), prepend=0) > 0
        rows["sample"] = np.cumsum(fresh)
    if socket.known:
        for k in np.flatnonzero(~np.isin(rows["mode"], modes)):
            rows["mode"][k] = rows["mode"][k - 1] if k else modes[1]
    return rows


def fuzz(target: str, ticks: int, seed: int = 0) -> str:
    """Run a socket on random faults; what happened. Raises AssertionError where an output is not that of the unit."""
    socket = SOCKETS[target]
    controller = compiled_controller(arm(), socket.real, None, None, None, dict(SET))
    modes = list(controller.description["modes"].values())
    with np.errstate(over="ignore"):
        rows = random_inputs(controller._input.data.dtype, modes, ticks, seed)
        rows[0] = random_inputs(controller._input.data.dtype, modes, 1, SOUND)[0]
    seen = adapted(socket, rows, modes)
    outputs, resets = expected(controller, seen, seed, socket.restart, socket.retries)
    with tempfile.TemporaryDirectory(prefix="rrrgen-sockets-") as name:
        found = socket.run(Run(Path(name), seen if not socket.known else rows, resets, outputs, controller))
    for name in outputs.dtype.names or ():
        assert np.isfinite(found[name]).all(), f"{target}: {name} is not finite"
        np.testing.assert_array_equal(found[name], outputs[name], err_msg=f"{target}: {name}")
    told, bad = controller.faults(int(np.bitwise_or.reduce(outputs["status"]))), np.count_nonzero(outputs["status"])
    return f"{ticks} ticks, {bad} with a fault of {len(told)} kinds, {np.count_nonzero(resets)} resets"


@click.command()
@click.option("--ticks", default=1_000_000, show_default=True, help="Of each socket.")
@click.option(
    "--target", "targets", multiple=True, type=click.Choice(list(SOCKETS)), help="A socket; repeat for several."
)
@click.option("--seed", default=0, show_default=True)
def main(targets: tuple[str, ...], ticks: int, seed: int) -> int:
    """Run random faults through every socket, and compare its outputs with those of the unit bit by bit."""
    sound = True
    for target in targets or SOCKETS:
        if SOCKETS[target].missing:
            click.echo(f"{target}: left out, needs {SOCKETS[target].missing}")
            continue
        for first in range(0, ticks, BATCH):
            try:
                click.echo(f"{target}: {fuzz(target, min(BATCH, ticks - first), seed + 2 * first)}")
            except AssertionError as error:
                click.echo(f"{target}: {str(error)[:2000]}")
                sound = False
                break
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(main(standalone_mode=False))
