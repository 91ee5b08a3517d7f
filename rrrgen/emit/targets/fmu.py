"""Export as FMUs (FMI 2.0): the arm as a plant driven by joint torques, for model exchange and co-simulation.

The FMUs beside it, for co-simulation, are those of :mod:`rrrgen.emit.targets.fmu_blocks`: the controller and motions.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from rrrgen.base.errors import DerivationError
from rrrgen.base.templates import render
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.emit.description import title
from rrrgen.emit.printing import plain
from rrrgen.emit.targets.c_package import Code, emitted_code
from rrrgen.emit.targets.fmu_blocks import BLOCKS, HARMONICS, POINTS
from rrrgen.emit.targets.interface import Contents, Exported, Exporter, ExportOptions
from rrrgen.emit.targets.shared_libraries import Platform, platforms, shared_library, zip_archive
from rrrgen.program import Program, Role
from rrrgen.robot.model.mechanism import refuse_newton
from rrrgen.robot.spec import RobotSpec, joint_units

WIDTH = 0.01
"""Default speed, rad/s or m/s, below which the sign function in friction laws is smoothed; a parameter of the FMU."""

TOLERANCE = 1e-8
"""Default relative and absolute error tolerance of a co-simulation step; a parameter of the FMU."""


@dataclass(frozen=True)
class _Block:
    """A vector of FMU variables, such as ``q``, whose value references are consecutive and begin with ``start``.

    ``values`` are the start values; ``descriptions`` and ``units`` have one entry for each variable; ``causality``,
    ``variability`` and ``initial`` are the attributes of these names in FMI, equal for all.
    """

    name: str
    start: int
    values: tuple[float, ...]
    descriptions: tuple[str, ...]
    units: tuple[str, ...]
    causality: str
    variability: str
    initial: str = ""
    derivative_of: int | None = None  # value reference of the first variable that these are derivatives of

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.values)

    @property
    def variables(self) -> list[dict[str, Any]]:
        """Template variables of the entries in ``modelDescription.xml``, one for each FMU variable."""
        bare = self.size == 1 and self.name == "tolerance"
        return [
            {
                "name": self.name if bare else _element_name(self.name, i + 1),
                "reference": self.start + i,
                "start": repr(self.values[i]),
                "description": self.descriptions[i],
                "unit": self.units[i],
                "causality": self.causality,
                "variability": self.variability,
                "initial": self.initial,
                "derivative": None if self.derivative_of is None else self.derivative_of + i + 1,
            }
            for i in range(self.size)
        ]


def _element_name(name: str, number: int) -> str:
    """FMI name of element ``number`` (from 1) of a vector: ``q[1]``, or ``der(q[1])`` for a derivative."""
    return f"der({name[4:-1]}[{number}])" if name.startswith("der(") else f"{name}[{number}]"


def _write(spec: RobotSpec, options: ExportOptions) -> Exported:
    refuse_newton(spec, "a plant for simulation")
    chosen = platforms(options.platforms)
    missing = [platform.name or platform.tag for platform in chosen if not platform.fmi]
    if missing:
        raise DerivationError(f"FMI 2.0 has no platform for {', '.join(missing)}; it has linux64, darwin64 and win64")
    code = emitted_code(spec)
    if code.model.beta_nominal is None:
        raise DerivationError(f"{spec.name} has no links, and a plant needs their inertia")
    values = _values(code)
    files: dict[str, Contents] = {f"{spec.name}.fmu": _archive(spec.name, code, "", values, chosen)}
    held = [block for block in BLOCKS if block.word in options.further]
    whole = emitted_code(spec, "double", options.further, options.unit) if held else code
    for block in held:
        name = f"{spec.name}_{block.kind}"
        files[f"{name}.fmu"] = _archive(name, block.code(whole), block.kind, block.values(whole), chosen)
    values |= {"unit": options.unit and options.unit.description, "folders": [platform.fmi for platform in chosen]}
    values |= {"held": [block.kind for block in held], "points": POINTS, "harmonics": HARMONICS}
    files["README.md"] = render("fmu/README.md.j2", **values)
    return Exported(files, tuple(_notes(spec)))


def _archive(name: str, code: Code, kind: str, values: dict[str, Any], chosen: Sequence[Platform]) -> bytes:
    """The bytes of the FMU ``name``: description, libraries, and the sources ``code`` with the functions of FMI.

    ``kind`` is "" for the plant, else that of a block; ``values`` are variables of the templates.
    """
    sources = {**code.files, f"{name}_fmu.c": render(f"fmu/{kind or 'fmu'}.c.j2", **values)}
    values["sources"] = [file for file in sources if file.endswith(".c")]
    description = f"fmu/{'coSimulation' if kind else 'model'}Description.xml.j2"
    contents: dict[str, Contents] = {"modelDescription.xml": render(description, **values)}
    for platform in chosen:
        contents[f"binaries/{platform.fmi}/{name}{platform.suffix}"] = shared_library(sources, platform)
    contents |= {f"sources/{file}": text for file, text in sources.items()}
    return zip_archive(contents)


def _values(code: Code) -> dict[str, Any]:
    blocks = {block.name: block for block in _blocks(code)}
    friction = code.programs["smooth_friction"] if "friction" in code.programs else None
    places = {
        Role.POSITION: "q",
        Role.VELOCITY: "dq",
        Role.TORQUE: "torque",
        Role.BASE_PARAMETERS: "beta",
        Role.FRICTION: "friction",
        Role.OTHER: "friction_width",
    }
    return {
        **code.naming,
        "title": title(code.model.spec),
        "guid": str(uuid.uuid5(uuid.NAMESPACE_URL, f"rrrgen {code.identity.tool_version} {code.identity.model_hash}")),
        "blocks": blocks,
        "size": sum(block.size for block in blocks.values()),
        "dynamics": _arguments(code.programs["forward_dynamics"], places),
        "friction": None if friction is None else _arguments(friction, places),
    }


def _arguments(program: Program, places: dict[Role, str]) -> list[str]:
    """Names of the variable blocks from which the inputs of ``program`` are read, in order."""
    return [places[port.role] for port in program.inputs]


def _blocks(code: Code) -> Iterator[_Block]:
    start = 0
    for name, values, descriptions, units, causality, variability, initial in _tables(code):
        derivative_of = {"der(q)": 0, "der(dq)": code.model.spec.n}.get(name)
        units = tuple(units) or ("",) * len(values)
        meanings, kind = tuple(map(plain, descriptions)), (causality, variability, initial)
        yield _Block(name, start, tuple(values), meanings, units, *kind, derivative_of)
        start += len(values)


def _tables(code: Code) -> Iterator[tuple[Any, ...]]:
    """Yield each variable block: name, start values, descriptions, units, causality, variability and initial."""
    spec, model = code.model.spec, code.model
    joints = [joint.name for joint in spec.joints]
    q, tau = ([joint_units(joint)[key] for joint in spec.joints] for key in ("unit", "torque_unit"))
    zero = [0.0] * spec.n
    state = ("output", "continuous", "exact")
    rates = ("local", "continuous", "calculated")
    fixed = ("parameter", "tunable", "exact")
    yield "q", zero, [f"position of joint {j}" for j in joints], q, *state
    yield "dq", zero, [f"speed of joint {j}" for j in joints], _per(q, "s"), *state
    yield "der(q)", zero, [f"derivative of the position of joint {j}" for j in joints], _per(q, "s"), *rates
    yield "der(dq)", zero, [f"acceleration of joint {j}" for j in joints], _per(q, "s2"), *rates
    yield "torque", zero, [f"drive torque at joint {j}" for j in joints], _units(tau), "input", "continuous", ""
    beta = [f"base parameter {p.name} = {p.expression}" for p in model.base_parameters]
    yield "beta", _floats(model.beta_nominal), beta, (), *fixed
    inertia = _floats(model.drive_inertia_nominal)
    if inertia:  # follow beta, so that both are one array for the model
        yield "Ia", inertia, [f"drive inertia {k + 1}" for k in range(len(inertia))], (), *fixed
    if "friction" in code.programs:
        known = friction_parameters(spec)
        yield "friction", [float(value) for _, value in known], [f"friction: {name}" for name, _ in known], (), *fixed
        width = next(port for port in code.programs["smooth_friction"].inputs if port.name == "width")
        meaning = ["speed below which friction is smoothed"] * width.size
        yield "friction_width", [WIDTH] * width.size, meaning, (), *fixed
    meaning = ["largest error of a step of the co-simulation"]
    yield "tolerance", [TOLERANCE], meaning, (), "parameter", "fixed", "exact"


def _floats(values: Sequence[Any] | None) -> list[float]:
    return [float(value) for value in values or ()]


def _per(units: Sequence[str], time: str) -> list[str]:
    return [f"{unit}/{time}" for unit in units]


def _units(units: Sequence[str]) -> list[str]:
    """Units in FMI notation, with a dot between factors: ``N.m``."""
    return [unit.replace(" ", ".") for unit in units]


def _notes(spec: RobotSpec) -> Iterator[str]:
    if spec.floating_base:
        yield "the free base is held: the plant has no motions of the base, and does not fall"
    if any(joint.limits.lower is not None or joint.limits.upper is not None for joint in spec.joints):
        yield "limits of positions are left out: the plant has no stops"
    if any(joint.friction is not None for joint in spec.joints):
        yield f"friction is smoothed below {WIDTH} rad/s or m/s (friction_width), so that it can be integrated"


EXPORTER = Exporter(
    "fmu",
    "FMI 2.0 FMU of the plant, model exchange and co-simulation, for Simulink, Modelica tools, FMPy and others",
    _write,
    one_file=False,
    mechanisms=True,
    loops=True,
    options=("platforms",),
    further=("controller", "timing", "trajectory"),
)
