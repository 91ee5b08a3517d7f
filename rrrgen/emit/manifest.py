"""``manifest.json``: the emitted functions, parameters and files in machine-readable form."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rrrgen.base.files import MANIFEST, MANIFEST_SCHEMA, Contents, checksum
from rrrgen.derive.parameters.listing import listing
from rrrgen.emit import Real
from rrrgen.emit.c.stack import stack_bound
from rrrgen.program import Port, Program, count_operations
from rrrgen.robot.identity import Identity, identify
from rrrgen.robot.model.drives import drives_data
from rrrgen.robot.model.mechanism import mechanism_data
from rrrgen.robot.spec import JointSpec, joint_units

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit.interface import Rounding


def manifest(
    model: DerivedModel,
    identity: Identity,
    real: Real,
    files: Mapping[str, Contents],
    inverse_kinematics: Mapping[str, Any],
    any_gravity: DerivedModel | None = None,
    rounding: Rounding | None = None,
) -> str:
    """The text of the manifest: identity, conventions, functions, base parameters, hashes of the files.

    ``inverse_kinematics`` is the entry of that name, from :func:`rrrgen.emit.c.ik.files.manifest`;
    ``any_gravity`` is the model written beside this one, which takes gravity as an input; ``rounding`` are the
    bounds of rounding errors, if they were proven.
    """
    spec = model.spec
    content = {
        "schema": f"{MANIFEST_SCHEMA}1",
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
        **_parameters_and_functions(model, real, rounding or {}),
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
    return named | _parameters_and_functions(model, real, {})


def _parameters_and_functions(model: DerivedModel, real: Real, rounding: Rounding) -> dict[str, Any]:
    parameters = listing(model)
    inertias = [{"name": p.name, "unit": p.unit, "nominal": p.nominal} for p in parameters.drives]
    return {
        "base_parameters": [
            {"name": p.name, "expression": str(p.expression), "unit": p.unit, "nominal": p.nominal}
            for p in parameters.rows
        ],
        **({"drive_inertias": inertias} if inertias else {}),
        "regrouping": [{"parameter": r.parameter, "formula": r.formula, "reason": r.reason} for r in model.regrouping],
        "functions": {
            name: _function(program, real) | ({"rounding": dict(rounding[name].data)} if name in rounding else {})
            for name, program in model.programs.items()
        },
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
