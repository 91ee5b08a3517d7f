"""Export as a CUDA header: every function of the model for device code, and a kernel that evaluates it for a batch.

The bodies are those of the emitted C, with sines and cosines from CUDA's library. A kernel reads and writes structures
of arrays, so that neighbouring threads touch neighbouring addresses; the state of one thread stays in registers.
"""

from __future__ import annotations

from dataclasses import dataclass

from rrrgen.base.templates import render
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.emit import Real
from rrrgen.emit.c.header_comments import explanation, function_name
from rrrgen.emit.c.language import Dialect, print_body
from rrrgen.emit.c.robot_files import failures_of
from rrrgen.emit.description import facts, parameter_lines, programs_of, title
from rrrgen.emit.printing import columns, with_free_ports, wrap
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.emit.targets.interface import Exported, Exporter, ExportOptions
from rrrgen.program import Op, Port, Program, Role
from rrrgen.robot.identity import Identity
from rrrgen.robot.spec import RobotSpec

_TAKEN = frozenset(("count", "state", "status", "stride"))
"""Names in a kernel that arguments and results must not have."""


class _LibrarySinCos:
    """Sine and cosine of an angle by one call of CUDA's library."""

    def preamble(self, dialect: Dialect) -> str:
        """Empty: nothing to define."""
        return ""

    def description(self, dialect: Dialect) -> str:
        """A clause for the header on the source of sines and cosines."""
        return f"{dialect.function('sincos')} of CUDA's library"

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """One call for both; the compiler drops what is not used."""
        if sine is None or cosine is None:
            name, function = (sine, "sin") if sine is not None else (cosine, "cos")
            return [f"const {dialect.real_type} {name} = {dialect.function(function)}({angle});"]
        return [f"{dialect.real_type} {sine}, {cosine};", f"{dialect.function('sincos')}({angle}, &{sine}, &{cosine});"]


@dataclass(frozen=True)
class _CudaFunction:
    """The texts of one device function, and of its kernel: declarator ``batch`` and the lines of its loop."""

    name: str
    prototype: str
    explanation: tuple[str, ...]
    body: tuple[str, ...]
    batch: str
    loop: tuple[str, ...]


def _write(spec: RobotSpec, options: ExportOptions) -> Exported:
    models = [derived_model(spec, options.further)]
    if "gravity" in options.further:
        models.append(derived_model(spec.in_any_gravity(), options.further))
    return Exported({f"{model.spec.name}.cuh": _header(model, identity, options.real) for model, identity in models})


def _header(model: DerivedModel, identity: Identity, real: Real) -> str:
    dialect = Dialect(model.spec.name, real)
    programs = [with_free_ports(program, _TAKEN) for program in programs_of(model).values()]
    return render(
        "cuda/batches.cuh.j2",
        prefix=dialect.prefix,
        macro=dialect.macro,
        real=real,
        identity=identity,
        n=model.spec.n,
        b=model.beta_size,
        opening=_opening(model, identity, dialect),
        failures=failures_of(programs, dialect),
        checks=any(node.op is Op.NONFINITE for program in programs for node in program.nodes),
        functions=[_function(program, dialect) for program in programs],
    )


def _opening(model: DerivedModel, identity: Identity, dialect: Dialect) -> list[str]:
    lines = [f"{dialect.prefix}.cuh: {title(model.spec)}, for CUDA C++ and NVRTC", ""]
    rows = [
        *facts(model, identity).items(),
        ("Precision", f"{dialect.real}; the typedef {dialect.real_type} is the only switch"),
        ("Sine, cosine", _LibrarySinCos().description(dialect)),
    ]
    lines += [*columns(rows, indent=""), ""]
    lines += wrap(
        "Functions take one state each; matrices are row-major, outputs must not overlap inputs. A kernel named "
        f"{dialect.prefix}_batch_<function> evaluates <function> for `count` states that lie in device memory as a "
        "structure of arrays: element e of state k of an argument is at [e*count + k]. Base parameters, friction "
        "parameters, named lengths and gravity are shared by all states: element e is at [e]. Any grid and block size "
        "is right. Outputs must not overlap inputs."
    )
    return [*lines, "", *parameter_lines(model, str(model.beta_size))]


def _is_shared(port: Port) -> bool:
    return port.role.is_parameter or port.role is Role.GRAVITY


def _function(program: Program, dialect: Dialect) -> _CudaFunction:
    real, name = dialect.real_type, function_name(program, dialect)
    inputs, outputs = program.inputs, program.data_outputs
    parameters = [f"const {real} *{port.name}" if port.shape else f"{real} {port.name}" for port in inputs]
    parameters += [f"{real} *{port.name}" for port in outputs]
    arrays = [f"const {real} *__restrict__ {port.name}" for port in inputs]
    arrays += [f"{real} *__restrict__ {port.name}" for port in outputs]
    arrays += ["int *__restrict__ status"] if program.status else []
    call = ", ".join(_argument(port, port in outputs) for port in (*inputs, *outputs))
    loop = [line for port in inputs if not _is_shared(port) for line in _load(port, real)]
    loop += [f"{real} {port.name}_one{f'[{port.size}]' if port.shape else ''};" for port in outputs]
    loop.append(f"status[state] = (int){name}({call});" if program.status else f"{name}({call});")
    loop += [line for port in outputs for line in _store(port)]
    returns = f"{dialect.prefix}_status" if program.status else "void"
    return _CudaFunction(
        name=name,
        prototype=f"{returns} {_declarator(name, parameters)}",
        explanation=tuple(explanation(program, dialect, on_device=True)),
        body=tuple(print_body(program, dialect, _LibrarySinCos())),
        batch=_declarator(f"{dialect.prefix}_batch_{program.name}", ["size_t count", *arrays]),
        loop=tuple(loop),
    )


def _declarator(name: str, parameters: list[str]) -> str:
    line = f"{name}({', '.join(parameters)})"
    return line if len(line) < 96 else f"{name}(\n    " + ",\n    ".join(parameters) + ")"


def _argument(port: Port, output: bool) -> str:
    """What a kernel hands to the function of one state: a local of the thread, or the shared array."""
    if _is_shared(port) and not output:
        return port.name if port.shape else f"*{port.name}"
    return f"&{port.name}_one" if output and not port.shape else f"{port.name}_one"


def _load(port: Port, real: str) -> list[str]:
    """The statements that read a port of one state into a local."""
    if not port.shape:
        return [f"const {real} {port.name}_one = {port.name}[state];"]
    elements = [f"{port.name}[{f'{k}*count + ' if k else ''}state]" for k in range(port.size)]
    lines, line = [], f"const {real} {port.name}_one[{port.size}] = {{"
    for k, element in enumerate(elements):
        piece = element + ("};" if k + 1 == len(elements) else ", ")
        if len(line) + len(piece) > 104:
            lines.append(line.rstrip())
            line = "    "
        line += piece
    return [*lines, line]


def _store(port: Port) -> list[str]:
    """The statements that write a port of one state from its local."""
    if not port.shape:
        return [f"{port.name}[state] = {port.name}_one;"]
    return [f"{port.name}[{f'{k}*count + ' if k else ''}state] = {port.name}_one[{k}];" for k in range(port.size)]


EXPORTER = Exporter(
    "cuda",
    "CUDA header: device functions, and kernels for batches of states",
    _write,
    one_file=False,
    mechanisms=True,
    loops=True,
    options=("real",),
    further=("control", "elastic", "gravity", "hessian", "observer", "points", "tensors", "timing", "trajectory"),
)
