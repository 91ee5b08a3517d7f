"""Export as a ROS 2 package with plugins for inverse_dynamics_solver, kinematics_interface and MoveIt kinematics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rrrgen.base.templates import render
from rrrgen.emit.description import title
from rrrgen.emit.targets.c_package import FURTHER, Code, emitted_code
from rrrgen.emit.targets.interface import Contents, Exported, Exporter, ExportOptions
from rrrgen.emit.targets.urdf import EXPORTER as URDF
from rrrgen.program import Role
from rrrgen.robot.spec import RobotSpec

_PLUGINS = {
    "dynamics": ("InverseDynamics", "inverse_dynamics_solver", "inverse_dynamics_solver::InverseDynamicsSolver"),
    "kinematics": ("Kinematics", "kinematics_interface", "kinematics_interface::KinematicsInterface"),
    "controller": ("Controller", "controller_interface", "controller_interface::ControllerInterface"),
    "moveit": ("MoveItKinematics", "moveit_core", "kinematics::KinematicsBase"),
}
"""The plugins, by source file: the class, the ROS package of its interface, and its base class."""

_FILES = ("package.xml", "CMakeLists.txt", "README.md", "config/parameters.yaml", "src/parameters.hpp")


def _write(spec: RobotSpec, options: ExportOptions) -> Exported:
    code = emitted_code(spec, further=options.further, unit=options.unit)
    values = _values(code)
    files: dict[str, Contents] = {f"model/{name}": text for name, text in code.files.items()}
    for name in _FILES:
        files[name] = render(f"ros2/{name.rpartition('/')[2]}.j2", **values)
    for plugin, (kind, _, base) in values["plugins"].items():
        files[f"src/{plugin}.cpp"] = render(f"ros2/{plugin}.cpp.j2", **values)
        files[f"{plugin}_plugin.xml"] = render("ros2/plugin.xml.j2", **values, plugin=plugin, kind=kind, base=base)
    notes = list(_notes(code))
    if code.unit is not None:
        files["config/controller.yaml"] = render("ros2/controller.yaml.j2", **values)
        files["launch/controller.launch.py"] = render("ros2/controller.launch.py.j2", **values)
        described = URDF.write(spec, options)
        files |= {f"urdf/{name}": text for name, text in described.files.items()}
        notes += described.notes
    return Exported(files, tuple(notes))


def _values(code: Code) -> dict[str, Any]:
    programs, model = code.programs, code.model
    solves_poses = code.plan.solvable and code.plan.task != "position"
    friction = next(port for port in programs["friction_with"].inputs if port.role is Role.FRICTION)
    return {
        **code.naming,
        "title": title(model.spec),
        "package": f"{model.spec.name.lower()}_ros",
        "plugins": {
            name: row
            for name, row in _PLUGINS.items()
            if {"moveit": solves_poses, "controller": code.unit is not None}.get(name, True)
        },
        "nominal": model.beta_nominal is not None,
        "beta": [float(value) for value in model.nominal.get(Role.BASE_PARAMETERS, ())],
        "friction_size": friction.size,
        "stated_friction": "nominal_friction" in programs,
    }


def _notes(code: Code) -> Iterator[str]:
    if not code.plan.solvable or code.plan.task == "position":
        yield "no plugin for MoveIt: this arm has no inverse kinematics for poses"
    if code.model.beta_nominal is None:
        yield "the robot file has no links: beta must be given as a parameter"


EXPORTER = Exporter(
    "ros2",
    "ROS 2 package with plugins of inverse_dynamics_solver, kinematics_interface and MoveIt kinematics",
    _write,
    one_file=False,
    further=FURTHER,
)
