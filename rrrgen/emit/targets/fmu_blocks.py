"""FMUs for co-simulation beside the plant: the controller as one unit, and the desired motions that it can follow.

The variables of each are rows like those that describe the structs of the controller; FMI 2.0 has no arrays, so that
every element is a variable. The outputs of a motion, such as ``q_d[1]``, belong to the inputs of the controller,
``in.q_d[1]``.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.emit.c.path_timing import further_inputs
from rrrgen.emit.description import title
from rrrgen.emit.targets.c_package import Code
from rrrgen.robot.spec import RobotSpec

POINTS = 51
"""Most points of a path. At 51 points a motion is longer by 0.4 % than the limits at the points alone allow
(docs/path-timing.md)."""

HARMONICS = 10
"""Harmonics of a Fourier series; an exciting motion has five unless its user wants others."""

BASE_FREQUENCY = 0.1
"""Default of the base frequency of a Fourier series, Hz."""

STEP = 1e-3
"""Length of the steps that the description of a motion proposes, s."""

POSITION, SPEED, ACCELERATION, TORQUE = "rad | m", "rad/s | m/s", "rad/s^2 | m/s^2", "N m | N"


@dataclass(frozen=True)
class Variables:
    """The variables of a block, dictionaries for the templates, and the length of a step that it proposes, s."""

    parameters: list[dict[str, Any]]
    inputs: list[dict[str, Any]]
    outputs: list[dict[str, Any]]
    step: float


@dataclass(frozen=True)
class Block:
    """An FMU ``<robot>_<kind>.fmu``, written if the package holds ``word``; ``what`` says what it is.

    Its C is the template ``fmu/<kind>.c.j2``, which calls the functions of ``<robot>_<kind>.h``. ``called`` are the C
    files that it needs, by what follows the name of the robot; None for all.
    """

    kind: str
    word: str
    what: str
    variables: Callable[[Code], Variables]
    called: tuple[str, ...] | None = None

    def code(self, whole: Code) -> Code:
        """The package ``whole`` with the files that the block needs."""
        if self.called is None:
            return whole
        stems = {f"{whole.dialect.prefix}{suffix}" for suffix in self.called}
        return replace(whole, files={k: text for k, text in whole.files.items() if k.rpartition(".")[0] in stems})

    def values(self, code: Code) -> dict[str, Any]:
        """Template variables of the FMU in the package ``code``."""
        variables, spec = self.variables(code), code.model.spec
        every = [*variables.parameters, *variables.inputs, *variables.outputs]
        abi = "" if code.unit is None else code.unit.description["abi"]
        key = f"rrrgen {code.identity.tool_version} {code.identity.model_hash} {self.kind} {abi}"
        return {
            **code.naming,
            "name": f"{spec.name}_{self.kind}",
            "what": self.what,
            "title": title(spec),
            "guid": str(uuid.uuid5(uuid.NAMESPACE_URL, key)),
            "variables": every,
            "first": {"in": len(variables.parameters), "out": len(variables.parameters) + len(variables.inputs)},
            "units": sorted({v["unit"] for v in every if v["unit"]}),
            "period": variables.step,
            "points": POINTS,
            "harmonics": HARMONICS,
            "base_frequency": BASE_FREQUENCY,
            "friction": len(friction_parameters(spec)),
        }


def _controller(code: Code) -> Variables:
    """The fields of the controller's structs, and an input that resets it."""
    assert code.unit is not None
    spec, structs, modes = code.model.spec, code.unit.description["structs"], code.unit.description["modes"]
    parameters = [v for row in structs["params"]["fields"] for v in _elements(row, "params", "parameter", spec)]
    read = [row for row in structs["input"]["fields"] if row["name"] not in ("dt", "sample")]
    inputs = [v for row in read for v in _elements(row, "in", "input", spec)]
    for v in inputs:
        v["start"] = modes["gravity"] if v["name"] == "in.mode" else "0"
    reset = _row("reset", None, "", "the controller leaves a stop or the brake where this becomes other than 0", 0)
    inputs += _elements({**reset, "type": "int32"}, "", "input", spec)
    outputs = [v for row in structs["output"]["fields"] for v in _elements(row, "out", "output", spec)]
    return Variables(parameters, inputs, outputs, structs["params"]["fields"][0]["default"][0])


def _fourier(code: Code) -> Variables:
    """The coefficients of a Fourier series; the motion at the end of a step."""
    n = code.model.spec.n
    table: dict[str, Any] = {"columns": HARMONICS, "joint": lambda k: k // HARMONICS}
    rows = [
        _begin(),
        _row("base_frequency", None, "Hz", "base frequency", BASE_FREQUENCY, low=0.0),
        _row("q0", n, POSITION, "position without the harmonics"),
        _row("a", n * HARMONICS, SPEED, "speed amplitude of the cosine of a harmonic", **table),
        _row("b", n * HARMONICS, SPEED, "speed amplitude of the sine of a harmonic", **table),
    ]
    return Variables(_all(rows, "parameter", code), [], _all(_motion(n), "output", code), STEP)


def _timing(code: Code) -> Variables:
    """A path and its limits; the fastest motion along it, and how close it comes to the limits."""
    spec, n = code.model.spec, code.model.spec.n
    limits = [joint.limits for joint in spec.joints]
    known = {"beta": [*(code.model.beta_nominal or ()), *(code.model.drive_inertia_nominal or ())]}
    friction = [float(value) for _, value in friction_parameters(spec)]

    def limit(name: str, key: str, unit: str, what: str) -> dict[str, Any]:
        values = ["inf" if getattr(bounds, key) is None else float(getattr(bounds, key)) for bounds in limits]
        return _row(name, n, unit, f"largest {what}; INF for none", values, low=0.0, infinite=True)

    table: dict[str, Any] = {"columns": n, "joint": lambda k: k % n}
    rows = [
        {**_row("points", None, "", "points of the path; 0: the arm stays at q[1,..]", 0), "type": "int32"},
        _begin(),
        _row("s", POINTS, "", "path parameter at the points, rising"),
        _row("q", POINTS * n, POSITION, "position at a point", **table),
        _row("q_s", POINTS * n, "", "derivative of the position by s at a point", **table),
        _row("q_ss", POINTS * n, "", "second derivative of the position by s at a point", **table),
        limit("tau_max", "torque", TORQUE, "torque"),
        limit("dq_max", "velocity", SPEED, "speed"),
        limit("ddq_max", "acceleration", ACCELERATION, "acceleration"),
        _row("friction", len(friction), "", "parameter of friction", friction),
        *(
            _row(port.name, port.size, "", port.meaning, [float(x) for x in known[port.name]])
            for port in further_inputs(code.programs["path_dynamics"])
        ),
    ]
    outputs = [
        *_motion(n),
        _row("duration", None, "s", "time from the first point to the last"),
        _row("stretch", None, "", "how much longer than the limits at the points alone allow"),
        _row("torque_share", None, "", "largest torque over its limit, at the points and eighths between them"),
        _row("speed_share", None, "", "largest speed over its limit"),
        _row("acceleration_share", None, "", "largest acceleration over its limit"),
    ]
    return Variables(_all(rows, "parameter", code), [], _all(outputs, "output", code), STEP)


BLOCKS = (
    Block("controller", "controller", "Controller", _controller),
    Block("fourier", "trajectory", "Motion by a Fourier series for the joints", _fourier, ("_fourier",)),
    Block("timing", "timing", "Fastest motion along a path", _timing, ("", "_nominal", "_timing")),
)
"""All blocks."""


def _begin() -> dict[str, Any]:
    return _row("begin", None, "s", "time at which the motion begins", 0.0)


def _motion(n: int) -> list[dict[str, Any]]:
    return [
        _row("q_d", n, POSITION, "desired position"),
        _row("dq_d", n, SPEED, "desired speed"),
        _row("ddq_d", n, ACCELERATION, "desired acceleration"),
    ]


def _row(name: str, count: int | None, unit: str, text: str, start: Any = 0.0, **more: Any) -> dict[str, Any]:
    """A row for ``count`` numbers, or one if it is None, that lie in a member of the instance of their own.

    ``start`` is the start value of all or the list of them. ``more`` are other keys; a table has ``columns``, and
    ``joint``, the number of the joint of an element.
    """
    starts = start if isinstance(start, list) else [start] * (count or 1)
    return {
        "name": name,
        "count": count,
        "unit": unit,
        "text": text,
        "offset": 0,
        "type": "real",
        "default": starts,
        **more,
    }


def _all(rows: Sequence[Mapping[str, Any]], causality: str, code: Code) -> list[dict[str, Any]]:
    return [v for row in rows for v in _elements(row, "", causality, code.model.spec)]


def _elements(row: Mapping[str, Any], struct: str, causality: str, spec: RobotSpec) -> Iterator[dict[str, Any]]:
    """The FMU variables of a field of a ``struct``, ``params.kp[1]`` and so on; "": of a member of the instance.

    Infinite bounds are left out, and so is the start value of an output.
    """
    integer, infinite, columns = row["type"] != "real", row.get("infinite", False), row.get("columns")
    numbers = [str(value).replace("inf", "INF") for value in row.get("default", ()) if causality != "output"]
    for k in range(row["count"] or 1):
        place = f"[{k + 1}]" if columns is None else f"[{k // columns + 1},{k % columns + 1}]"
        place = "" if row["count"] is None else place
        joint = row["joint"](k) if columns else k
        yield {
            "name": f"{struct}.{row['name']}{place}" if struct else f"{row['name']}{place}",
            "member": struct or row["name"],
            "offset": row["offset"] + k * (4 if integer else 8),
            "integer": integer,
            "causality": causality,
            "text": row["text"],
            "unit": "" if integer else _unit_of(row["unit"], joint, spec.n if columns else row["count"] or 1, spec),
            "low": _bound_text(row.get("low"), integer) if not infinite or row["low"] >= 0 else None,
            "high": _bound_text(row.get("high"), integer) if not infinite else None,
            "start": (str(int(float(numbers[k]))) if integer else numbers[k]) if numbers else None,
        }


def _bound_text(value: float | None, integer: bool) -> str | None:
    return None if value is None else str(int(value)) if integer else repr(float(value))


def _unit_of(units: str, k: int, count: int, spec: RobotSpec) -> str:
    """The unit of element ``k``, from "revolute | prismatic" or "linear, angular", in FMI notation; "" for none."""
    by_joint, by_axis = units.split(" | "), units.split(", ")
    if len(by_joint) == 2 and count == spec.n:
        (units,) = by_joint[:1] if spec.joints[k].is_revolute else by_joint[1:]
    elif len(by_axis) == 2 and count == 6:
        units = by_axis[k // 3]
    elif len(by_joint) + len(by_axis) > 2:
        return ""
    return "" if units in ("SI", "ticks") else units.replace(" ", ".").replace("^", "")
