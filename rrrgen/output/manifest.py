"""``manifest.json``: the emitted functions, parameters and files in machine-readable form."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from typing import TYPE_CHECKING, Any

from rrrgen.backends import Identity, Real
from rrrgen.backends.c.stack import stack_bound
from rrrgen.derive.parameter_listing import listing
from rrrgen.model.drive_text import drives_data
from rrrgen.model.mechanism import mechanism_data
from rrrgen.output.writer import MANIFEST, Contents, checksum
from rrrgen.program import Port, Program, count_operations
from rrrgen.robotfile.robot_spec import JointSpec, RobotSpec, joint_units
from rrrgen.version import VERSION

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel

_NOT_THE_ROBOT = frozenset(
    {"file", "faults", "places", "description", "source", "angle_unit", "length_unit", "provenance", "emit", "tools"}
)
"""Fields of a description that do not change the robot and are left out of its hash."""


def identify(spec: RobotSpec) -> Identity:
    """The hash of the robot and the version of rrrgen.

    The hash is that of the normalized description (SI units, exact numbers), independent of comments and spelling.
    """
    robot = _canonical(spec)
    if spec.drives is None:  # robots without coupled drives keep the hash that they had before these were known
        del robot["drives"]
    if spec.mechanism is None:
        del robot["mechanism"]
    for joint in robot["joints"]:
        for key in ("stiffness", "damping"):
            if joint["drive"] is not None and joint["drive"][key] is None:
                del joint["drive"][key]
    if not spec.gravity_input:
        del robot["gravity_input"]
    if spec.ik == "general":
        del robot["ik"]
    text = json.dumps(robot, sort_keys=True, separators=(",", ":"))
    return Identity(hashlib.sha256(text.encode()).hexdigest(), VERSION)


def _canonical(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in fields(value) if field.name not in _NOT_THE_ROBOT]
        return {name: _canonical(getattr(value, name)) for name in names}
    if isinstance(value, dict):
        return {key: _canonical(value[key]) for key in value}
    if isinstance(value, (tuple, list)):
        return [_canonical(item) for item in value]
    if value is None or isinstance(value, (str, bool, int)):
        return value
    return repr(value) if isinstance(value, float) else str(value)


def manifest(
    model: DerivedModel,
    identity: Identity,
    real: Real,
    files: Mapping[str, Contents],
    inverse_kinematics: Mapping[str, Any],
    any_gravity: DerivedModel | None = None,
) -> str:
    """The text of the manifest: identity, conventions, functions, base parameters, hashes of the files.

    ``inverse_kinematics`` is the entry of that name, from :func:`rrrgen.backends.c.solver.files.manifest`;
    ``any_gravity`` is the model written beside this one, which takes gravity as an input.
    """
    spec = model.spec
    content = {
        "schema": "rrrgen-manifest/1",
        "robot": spec.name,
        "model_hash": identity.model_hash,
        "tool": f"rrrgen {identity.tool_version}",
        "convention": spec.convention,
        "units": "SI, rad",
        "real": real,
        "n": spec.n,
        "b": len(model.base_parameters),
        "joints": [_joint(joint) for joint in spec.joints],
        "gravity": [str(component) for component in spec.gravity],
        **({} if spec.mechanism is None else {"mechanism": mechanism_data(spec)}),
        **({} if spec.drives is None else {"drives": drives_data(spec)}),
        "link_parameters": listing(model).statement,
        **_parameters_and_functions(model, real),
        **({} if any_gravity is None else {"any_gravity": _beside(any_gravity, real)}),
        "inverse_kinematics": dict(inverse_kinematics),
        "passes": [
            {"pass": p.name, "function": p.function, "before": p.before.as_dict(), "after": p.after.as_dict()}
            for p in model.passes
        ],
        "files": {name: checksum(files[name]) for name in sorted(files) if name != MANIFEST},
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def _joint(joint: JointSpec) -> dict[str, Any]:
    """Name, type, units and limits of a joint; null for a limit that the robot file does not state."""
    return {"name": joint.name, "type": joint.type, **joint_units(joint), "limits": asdict(joint.limits)}


def _beside(model: DerivedModel, real: Real) -> dict[str, Any]:
    """The manifest's entry of the second model of the robot, in which gravity is an input."""
    named = {"prefix": model.name, "model_hash": identify(model.spec).model_hash, "b": len(model.base_parameters)}
    return named | _parameters_and_functions(model, real)


def _parameters_and_functions(model: DerivedModel, real: Real) -> dict[str, Any]:
    parameters = listing(model)
    inertias = [{"name": p.name, "unit": p.unit, "nominal": p.nominal} for p in parameters.drives]
    return {
        "base_parameters": [
            {"name": p.name, "expression": str(p.expression), "unit": p.unit, "nominal": p.nominal}
            for p in parameters.rows
        ],
        **({"drive_inertias": inertias} if inertias else {}),
        "regrouping": [{"parameter": r.parameter, "formula": r.formula, "reason": r.reason} for r in model.regrouping],
        "functions": {name: _function(program, real) for name, program in model.programs.items()},
    }


def _function(program: Program, real: Real) -> dict[str, Any]:
    return {
        "inputs": [_port(port) for port in program.inputs],
        "outputs": [_port(port) for port in program.outputs],
        "operations": count_operations(program).as_dict(),
        "stack": asdict(stack_bound(program, real)),
    }


def _port(port: Port) -> dict[str, Any]:
    return {"name": port.name, "shape": list(port.shape), "unit": port.unit, "frame": port.frame}
