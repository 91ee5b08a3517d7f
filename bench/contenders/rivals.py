"""The installed rivals as contenders: hand-written CasADi and Pinocchio."""

from __future__ import annotations

from collections.abc import Collection
from importlib import metadata, util
from pathlib import Path

import numpy as np

from bench.contenders.cases import Case, Numbers
from bench.contenders.contender import HAND, HAND_FILE, PINOCCHIO, Contender, Supplier
from bench.templates import source
from rrrgen.verify.references.numeric_robot import Array, centre_and_tensor

_INPUTS = {
    "inverse_dynamics": (0, 1, 2),
    "mass_matrix": (0,),
    "bias": (0, 1),
    "gravity": (0,),
    "forward_dynamics": (0, 1, 2),
    "inverse_dynamics_derivatives": (0, 1, 2),
    "forward_dynamics_derivatives": (0, 1, 2),
    "kinematics": (0,),
    "regressor": (0, 1, 2),
    "standard_regressor": (0, 1, 2),
    "regressor_transpose": (0, 1, 2, 3),
}
_WITH_BODIES = ("inverse_dynamics", "mass_matrix", "bias", "gravity", "forward_dynamics")
"""Functions that depend on inertias; only these are built again for the second set of numbers."""


def hand_contenders(case: Case, names: Collection[str] | None = None) -> Supplier | None:
    """The hand-made CasADi code with dense numbers, and with the file's; None without CasADi or with sliding joints."""
    if util.find_spec("casadi") is None or not all(case.chain.revolute):
        return None
    group = Supplier([])
    _add_hand(group, case, HAND, "dense", "", names)
    if case.file is not None:
        _add_hand(group, case, HAND_FILE, "file", "_file", names or _WITH_BODIES)
    return group


def _add_hand(
    group: Supplier, case: Case, label: str, numbers: Numbers, tag: str, names: Collection[str] | None
) -> None:
    from bench.contenders.casadi_code import c_source, operations
    from bench.contenders.hand_casadi import hand_functions
    from bench.contenders.joint_frames import joint_frames

    hand = hand_functions(joint_frames(case.chain, case.phi(numbers)), names)
    # CasADi guards its helper macros itself; only the exported names have to differ between the two files
    group.sources[f"hand{tag}.c"] = c_source(hand).replace("hand_", f"hand{tag}_")
    for name, function in hand.functions.items():
        symbol = f"hand{tag}_{name}"
        group.declarations += f"int {symbol}(const double **, double **, long long int *, double *, int);\n"
        inputs = ", ".join(f"in + {place * case.n}" for place in _INPUTS[name])
        statements = f"const double *arg[] = {{{inputs}}}; double *res[] = {{out}}; {symbol}(arg, res, 0, 0, 0);"
        outputs = int(function.numel_out(0))
        counts = operations(function)
        group.contenders.append(Contender(label, name, outputs, statements, numbers, hand.parameters.get(name), counts))


def pinocchio_contenders(case: Case) -> Supplier | None:
    """Pinocchio's headers with dense bodies; None where its wheel or Eigen's headers are missing."""
    includes = pinocchio_includes()
    if includes is None or not all(case.chain.revolute):
        return None
    n = case.n
    outputs = {
        "inverse_dynamics": n, "bias": n, "gravity": n, "forward_dynamics": n, "mass_matrix": n * n,
        "coriolis_matrix": n * n, "standard_regressor": 10 * n * n, "kinematics": 16 + 6 * n,
    }  # fmt: skip
    group = Supplier([], cpp=("pinocchio.cpp", source("pinocchio.cpp"), includes))
    joints, bodies, tool = _joint_frame_bodies(case)
    group.declarations = (
        _array("pinocchio_joints", joints) + _array("pinocchio_bodies", bodies) + _array("pinocchio_tool", tool)
    )
    group.declarations += _array("pinocchio_acceleration", case.chain.gravity)
    group.declarations += "void pinocchio_setup(int, const double *, const double *, const double *, const double *);\n"
    group.setup = f"pinocchio_setup({n}, pinocchio_joints, pinocchio_bodies, pinocchio_tool, pinocchio_acceleration);"
    for name, size in outputs.items():
        group.declarations += f"void pinocchio_{name}(const double *, double *);\n"
        parameters = _body_parameters(bodies) if name == "standard_regressor" else None
        group.contenders.append(Contender(PINOCCHIO, name, size, f"pinocchio_{name}(in, out);", "dense", parameters))
    return group


def pinocchio_includes() -> tuple[str, ...] | None:
    """Include flags of Pinocchio's wheel and of Eigen, which CasADi's wheel brings along."""
    if util.find_spec("pinocchio") is None:
        return None
    prefixes = {Path(str(file.locate())) for file in metadata.files("libpinocchio") or () if file.name == "rnea.hpp"}
    roots = [path.parents[2] for path in prefixes if path.parent.name == "algorithm" and path.exists()]
    eigen = [Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3")]
    casadi = util.find_spec("casadi")
    if casadi is not None and casadi.origin:
        eigen.insert(0, Path(casadi.origin).parent / "include" / "eigen3")
    eigen += [root / "eigen3" for root in roots]
    found = [path for path in eigen if (path / "Eigen" / "Core").exists()]
    if not roots or not found:
        return None
    return f"-I{roots[0]}", f"-I{found[0]}", "-DNDEBUG", "-w"


def _joint_frame_bodies(case: Case) -> tuple[Array, Array, Array]:
    """Joint placements (16 n), bodies (13 n: mass, centre, tensor about it, in joint axes), tool (16)."""
    offset, placements, bodies = case.chain.base, [], []
    for (before, after), row in zip(case.chain.around_joints(), case.dense, strict=True):
        placements.append(offset @ before)
        centre, tensor = centre_and_tensor(row)
        R = after[:3, :3]
        bodies.append(np.r_[row[0], R @ centre + after[:3, 3], (R @ tensor @ R.T).reshape(-1)])
        offset = after
    return np.ravel(placements), np.ravel(bodies), np.ravel(offset @ case.chain.tool)


def _body_parameters(bodies: Array) -> Array:
    """Pinocchio's order: m, m c, then Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the joint's origin."""
    rows = []
    for body in bodies.reshape(-1, 13):
        m, c = body[0], body[1:4]
        S = body[4:].reshape(3, 3) + m * (c @ c * np.eye(3) - np.outer(c, c))
        rows.append([m, *(m * c), S[0, 0], S[0, 1], S[1, 1], S[0, 2], S[1, 2], S[2, 2]])
    return np.ravel(rows)


def _array(name: str, values: Array) -> str:
    return f"static const double {name}[] = {{{', '.join(repr(float(v)) for v in values)}}};\n"


def installed_versions() -> dict[str, str]:
    """Versions of the installed rivals, for the report."""
    names = ("pin", "casadi", "EAIK", "ssik", "sympybotics")
    versions = {}
    for name in names:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions
