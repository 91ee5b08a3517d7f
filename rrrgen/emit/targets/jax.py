"""Export as a JAX module: pure functions of one state, for batches, derivatives and learning on any device.

The arithmetic is that of the emitted C, in its order, so that results agree with it to round-off.
"""

from __future__ import annotations

import json
import keyword
from collections.abc import Mapping
from dataclasses import dataclass

from rrrgen.base.templates import render
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.derive.parameters.listing import listing as parameter_listing
from rrrgen.emit.description import facts, programs_of, title
from rrrgen.emit.expressions import PythonTarget, element_names, escape_docstring, fold, listing
from rrrgen.emit.printing import Names, mathematics, plain, port_text, with_free_ports, wrap
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.emit.targets.interface import Exported, Exporter, ExportOptions
from rrrgen.program import Op, Port, Program, count_operations
from rrrgen.robot.identity import Identity
from rrrgen.robot.spec import RobotSpec

_CALLS = {
    Op.SIN: "jnp.sin",
    Op.COS: "jnp.cos",
    Op.SQRT: "jnp.sqrt",
    Op.EXP: "jnp.exp",
    Op.TANH: "jnp.tanh",
    Op.ABS: "jnp.abs",
    Op.NONFINITE: "_nonfinite",
    Op.SIGN: "jnp.sign",
    Op.MIN: "jnp.minimum",
    Op.SELECT: "jnp.where",
}
_RESERVED = frozenset(keyword.kwlist) | {"jax", "jnp", "kind", "status", "_given", "_array", "_nonfinite", "_status"}


@dataclass(frozen=True)
class _JaxFunction:
    """The texts of one function: its named tuple ``result`` with pairs of name and meaning, empty for one result."""

    name: str
    arguments: str
    docstring: str
    body: tuple[str, ...]
    result: str
    results: tuple[tuple[str, str], ...]


def _write(spec: RobotSpec, options: ExportOptions) -> Exported:
    files = {f"{spec.name}_jax.py": _module(*derived_model(spec, options.further))}
    if "gravity" in options.further:
        other, identity = derived_model(spec.in_any_gravity(), options.further)
        files[f"{other.spec.name}_jax.py"] = _module(other, identity)
    return Exported(files)


def _module(model: DerivedModel, identity: Identity) -> str:
    spec, programs = model.spec, programs_of(model)
    parameters = parameter_listing(model)
    values = [parameter.nominal for parameter in parameters.beta]
    heading = title(spec)
    return render(
        "jax/module.py.j2",
        robot=spec.name,
        module=f"{spec.name}_jax",
        title=f"{heading[0].upper()}{heading[1:]}",
        header=[
            line for name, text in facts(model, identity).items() for line in wrap(escape_docstring(f"{name}: {text}"))
        ],
        identity=identity,
        joints=_tuple("JOINTS", [json.dumps(joint.name) for joint in spec.joints]),
        heading=wrap(parameters.heading("beta")),
        base_parameters=[
            (json.dumps(p.name), json.dumps(p.unit), json.dumps(mathematics(p.expression))) for p in parameters.beta
        ],
        nominal=["BETA_NOMINAL = None"] if None in values else _tuple("BETA_NOMINAL", list(map(repr, values))),
        checks=any(node.op is Op.NONFINITE for program in programs.values() for node in program.nodes),
        statuses=any(program.status for program in programs.values()),
        example=_example(programs, spec.n),
        functions=[_function(program) for program in programs.values()],
    )


def _tuple(name: str, elements: list[str]) -> list[str]:
    """The lines that give ``name`` the tuple of these elements."""
    return fold(f"{name} = ({', '.join(elements)}{',' if len(elements) == 1 else ''})")


def _example(programs: Mapping[str, Program], n: int) -> list[str]:
    """Lines of code that call the inverse dynamics for 100 states at once."""
    program = programs.get("inverse_dynamics_nominal", programs["inverse_dynamics"])
    states = [port.name for port in program.inputs if port.name in ("q", "dq", "ddq")]
    axes = tuple(0 if port.name in states else None for port in program.inputs)
    mapped = f"jax.vmap(robot.{program.name}{'' if None not in axes else f', in_axes={axes}'})"
    return [
        f"{' = '.join(states)} = jnp.zeros((100, {n}))",
        f"torques = {mapped}({', '.join(port.name for port in program.inputs)})",
    ]


def _function(program: Program) -> _JaxFunction:
    program = with_free_ports(program, _RESERVED)
    names = Names(_RESERVED, [program.name, *(port.name for port in (*program.inputs, *program.outputs))])
    elements = [
        [port.name] if port.shape == () else element_names(names, port, *_matrix_size(port)) for port in program.inputs
    ]
    written = listing(program, elements, names, PythonTarget(_CALLS))
    body = [f'{port.name} = _given("{port.name}", {port.name}, {port.shape})' for port in program.inputs]
    body.append(f"kind = jnp.result_type({', '.join(port.name for port in program.inputs) or 'float'})")
    for port, given in zip(program.inputs, elements, strict=True):
        if port.shape:
            flat = port.name if len(port.shape) == 1 else f"{port.name}.ravel()"
            body += fold(f"[{', '.join(given)}] = {flat}")
    body += written.statements
    outputs = [
        (port, elements)
        for k, (port, elements) in enumerate(zip(program.outputs, written.results, strict=True))
        if not program.is_status(k)
    ]
    for port, row in outputs:
        arguments = ", ".join(row)
        value = f"_array({port.shape}, kind, {arguments})" if port.shape else f"jnp.asarray({arguments}, kind)"
        body += fold(f"{port.name} = {value}")
    returned = [port.name for port, _ in outputs]
    results = [(port.name, escape_docstring(_describe_port(port))) for port, _ in outputs]
    if program.status is not None:
        codes = tuple(failure.code for failure in program.status.failures)
        (value,) = written.results[program.status.output]
        body.append(f"status = _status({value}, {codes})")
        returned.append("status")
        results.append(("status", _meaning_of_status(program)))
    named = "".join(word.capitalize() for word in program.name.split("_"))
    body.append(f"return {returned[0]}" if len(returned) == 1 else f"return {named}({', '.join(returned)})")
    return _JaxFunction(
        name=program.name,
        arguments=", ".join(port.name for port in program.inputs),
        docstring=_docstring(program),
        body=tuple(body),
        result=named,
        results=tuple(results) if len(results) > 1 else (),
    )


def _matrix_size(port: Port) -> tuple[int, int]:
    """The port as a matrix: its last index counts the columns, the others together the rows; a vector is a column."""
    return (port.size, 1) if len(port.shape) == 1 else (port.size // port.shape[-1], port.shape[-1])


def _meaning_of_status(program: Program) -> str:
    assert program.status is not None
    failures = "; ".join(f"{failure.code} where {failure.meaning}" for failure in program.status.failures)
    return escape_docstring(f"0, or {failures}")


def _docstring(program: Program) -> str:
    lines = wrap(program.summary or program.name.replace("_", " "))
    if program.formula:
        lines += ["", *(f"    {plain(line)}" for line in program.formula.splitlines())]
    lines += ["", *(line for note in program.notes for line in wrap(note))] if program.notes else []
    lines += ["", "Args:", *(f"    {port.name}: {_describe_port(port)}" for port in program.inputs)]
    if len(program.data_outputs) == 1 and program.status is None:
        lines += ["", f"Returns: {_describe_port(program.data_outputs[0])}"]
    lines += ["", f"Operations: {count_operations(program)}."]
    return escape_docstring("\n".join(f"    {line}" if line else "" for line in lines).strip())


def _describe_port(port: Port) -> str:
    """What a port is, its unit, its frame and its shape."""
    shape = f"shape {port.shape}" if port.shape else ""
    return port_text(port, shape)


EXPORTER = Exporter(
    "jax",
    "JAX module: pure functions of one state, for batches (vmap), derivatives and learning on CPU and GPU",
    _write,
    one_file=False,
    mechanisms=True,
    loops=True,
    further=("control", "elastic", "gravity", "hessian", "observer", "points", "tensors", "timing", "trajectory"),
)
