"""Recorders of the dynamic functions: terms of the equation of motion and torques.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.recursions import energy_and_momentum as momentum
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions import newton_euler
from rrrgen.derive.recursions.coriolis import compose
from rrrgen.derive.recursions.linear_algebra import factorize, flat, rows, status_at
from rrrgen.derive.recursions.link_frames import Chain
from rrrgen.derive.recursions.velocities_and_accelerations import choose_frames
from rrrgen.program import Port, Program, Role
from rrrgen.program.builder import replay


def _weightless(chain: Chain) -> Chain:
    return replace(chain, gravity=[0, 0, 0])


def mass_matrix(r: FunctionBuilder) -> Program:
    """Record M(q), shape (n, n), kg m^2 (kg, kg m for prismatic joints), drive inertia included. (14.6)"""
    M = composite.mass_matrix(r.chain(), r.inertias())
    M = r.drive_inertia().added_to_mass(M)
    return r.builder.program(
        "mass_matrix", [(_mass_port(r), flat(M))], "Mass matrix.", "tau = M(q) ddq + c(q, dq) + g(q)"
    )


def _mass_port(r: FunctionBuilder) -> Port:
    return Port("M", (r.n, r.n), "SI", "", "symmetric mass matrix, drive inertia included")


def coriolis_matrix(r: FunctionBuilder) -> Program:
    """Record C(q, dq), shape (n, n), from the Christoffel symbols: c = C dq, and dM/dt - 2 C is skew-symmetric."""
    chain = r.chain()
    dq = r.joints("dq")
    C = compose(chain, dq, r.inertias()).coriolis_matrix()
    port = Port("C", (r.n, r.n), "SI", "", "Coriolis matrix of the Christoffel symbols")
    return r.builder.program(
        "coriolis_matrix", [(port, flat(C))], "Coriolis matrix.", "c = C(q, dq) dq,  dM/dt - 2 C skew, dM/dt = C + C'"
    )


def torque_port(r: FunctionBuilder, name: str, meaning: str) -> Port:
    """Make the output port ``name`` of joint torques (n,); ``meaning`` describes it in emitted files."""
    return Port(name, (r.n,), r.torque_unit, "", meaning, Role.TORQUE)


def _coriolis_port(r: FunctionBuilder) -> Port:
    return torque_port(r, "c", "Coriolis and centrifugal torques")


def _gravity_port(r: FunctionBuilder) -> Port:
    return torque_port(r, "g", "torques that hold the arm against gravity")


def link_frames_only(chain: Chain) -> list[bool]:
    """Choose the frame in which each link is computed: here always its link frame (True)."""
    return choose_frames(chain)


def block_frames_first(chain: Chain) -> list[bool]:
    """Choose the frame in which each link is computed: that of its block of parallel axes where possible (False)."""
    return choose_frames(chain, range(chain.n))


def block_frames_but_last(chain: Chain) -> list[bool]:
    """Choose the frame in which each link is computed: that of its block (False) where its block goes on behind it."""
    return choose_frames(chain, [i for i in range(chain.n) if any(chain.joints[k].parallel for k in chain.children[i])])


Frames = Callable[[Chain], list[bool]]


def coriolis(frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of the Coriolis and centrifugal torques c = C(q, dq) dq, shape (n,), N m or N.

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """

    def record(r: FunctionBuilder) -> Program:
        chain = _weightless(r.chain())
        dq = r.joints("dq")
        c = newton_euler.inverse_dynamics(chain, dq, [0] * r.n, r.inertias(), frames(chain))
        return r.builder.program(
            "coriolis", [(_coriolis_port(r), c)], "Coriolis and centrifugal torques.", "c = C(q, dq) dq"
        )

    return record


def bias(frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of the bias torques h = c(q, dq) + g(q), shape (n,), N m or N.

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """

    def record(r: FunctionBuilder) -> Program:
        chain = r.chain_in_gravity("dq")
        dq = r.joints("dq")
        torques = newton_euler.inverse_dynamics(chain, dq, [0] * r.n, r.inertias(), frames(chain))
        port = torque_port(r, "h", "torques for ddq = 0, friction not included")
        return r.builder.program(
            "bias", [(port, torques)], "Coriolis, centrifugal and gravity torques together.", "h = c(q, dq) + g(q)"
        )

    return record


def coriolis_transpose(r: FunctionBuilder) -> Program:
    """Record C(q, dq)' dq, shape (n,), for momentum observers: d(M dq)/dt = tau + C' dq - g."""
    chain = r.chain()
    dq = r.joints("dq")
    value = momentum.coriolis_transpose(chain, dq, r.inertias())
    port = torque_port(r, "p", "C' dq, the gradient of the kinetic energy with respect to q")
    return r.builder.program(
        "coriolis_transpose",
        [(port, value)],
        "Transposed Coriolis matrix times dq, for momentum observers.",
        "p = C(q, dq)' dq,  d(M dq)/dt = tau + C' dq - g",
    )


def gravity(r: FunctionBuilder) -> Program:
    """Record the gravity torques g = dU/dq, shape (n,), N m or N."""
    chain = r.chain_in_gravity()
    g = composite.gravity(chain, r.inertias())
    return r.builder.program("gravity", [(_gravity_port(r), g)], "Gravity torques.", "g = dU/dq")


def dynamics_terms(frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of M (n, n), c (n,) and g (n,) in one program, so that they share subexpressions.

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """

    def record(r: FunctionBuilder) -> Program:
        chain, dq, inertias = r.chain_in_gravity("dq"), r.joints("dq"), r.inertias()
        M = composite.mass_matrix(chain, inertias)
        M = r.drive_inertia().added_to_mass(M)  # here, because ports are printed in the order of declaration
        weightless = _weightless(chain)
        c = newton_euler.inverse_dynamics(weightless, dq, [0] * r.n, inertias, frames(chain))
        g = composite.gravity(chain, inertias)
        return r.builder.program(
            "dynamics_terms",
            [(_mass_port(r), flat(M)), (_coriolis_port(r), c), (_gravity_port(r), g)],
            "All terms of the equation of motion; they share their evaluation.",
            "tau = M(q) ddq + c(q, dq) + g(q)",
        )

    return record


def inverse_dynamics(frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of tau = M ddq + c + g, shape (n,), N m or N, without friction. (14.6)

    ``frames`` chooses for each link the frame in which it is computed: its link frame or that of its block.
    """

    def record(r: FunctionBuilder) -> Program:
        chain = r.chain_in_gravity("dq", "ddq")
        dq, ddq = r.joints("dq"), r.joints("ddq")
        tau = newton_euler.inverse_dynamics(chain, dq, ddq, r.inertias(), frames(chain))
        tau = r.drive_inertia().added_to_torques(tau, ddq)
        port = torque_port(r, "tau", "joint torques, friction not included")
        return r.builder.program(
            "inverse_dynamics",
            [(port, tau)],
            "Joint torques of the rigid body with drive inertia.",
            "tau = M(q) ddq + c(q, dq) + g(q)   (14.6)",
        )

    return record


def forward_dynamics(r: FunctionBuilder, mass: Program, torques: Program) -> Program:
    """Record ddq (n,) with M ddq = tau - h by M = L D L', from the programs of the mass matrix and the bias torques h.

    The parameter ports are those of the two programs. The status is 1 if M is not positive definite; ddq then is 0.
    """
    _, _, tau = (r.joints(name) for name in ("q", "dq", "tau"))
    if torques.takes(Role.GRAVITY):
        r.gravity()
    if mass.takes(Role.BASE_PARAMETERS):
        r.beta()
    M = rows(r.n, replay(mass, r.builder, r.inputs_of(mass))[0])
    h = replay(torques, r.builder, r.inputs_of(torques))[0]
    factors = factorize(r.builder, M, tips_first=r.branches)
    status, ddq = factors.status, factors.solve([t - b for t, b in zip(tau, h, strict=True)])
    unit = " | ".join(part + "/s^2" for part in r.position_unit.split(" | "))
    meaning = "joint accelerations; zero when the status is not ok"
    accelerations = Port("ddq", (r.n,), unit, "", meaning, Role.ACCELERATION)
    ports = [
        (accelerations, ddq),
        (Port("status", (), "1"), [status]),
    ]
    return r.builder.program(
        "forward_dynamics",
        ports,
        "Joint accelerations of the rigid body with drive inertia.",
        "M(q) ddq = tau - c(q, dq) - g(q), solved by L D L'",
        ["The status tells when M is not positive definite (a singular or unphysical set of parameters)."],
        status_at(len(ports) - 1),
    )


CORIOLIS = (coriolis(block_frames_first), coriolis(link_frames_only))
BIAS = (bias(block_frames_first), bias(link_frames_only))
DYNAMICS_TERMS = (dynamics_terms(block_frames_first), dynamics_terms(link_frames_only))
INVERSE_DYNAMICS = (inverse_dynamics(block_frames_first), inverse_dynamics(link_frames_only))


# ------------------------------------------------------------------------------------------------------------------
# The recorder of the energies of the robot.
# ------------------------------------------------------------------------------------------------------------------


def energy(r: FunctionBuilder) -> Program:
    """Record the kinetic energy dq' M dq / 2 and the potential energy U with dU/dq = g, both scalars, J."""
    chain = r.chain_in_gravity("dq")
    dq = r.joints("dq")
    inertias = r.inertias()
    kinetic = momentum.kinetic_energy(chain, dq, inertias)
    kinetic = r.drive_inertia().added_to_energy(kinetic, dq)
    potential = momentum.potential_energy(chain, inertias)
    ports = [
        (Port("kinetic", (), "J", "", "kinetic energy, drive inertia included"), [kinetic]),
        (Port("potential", (), "J", "", "potential energy, defined up to a constant"), [potential]),
    ]
    return r.builder.program(
        "energy",
        ports,
        "Kinetic and potential energy.",
        "kinetic = dq' M(q) dq / 2,  potential = U(q) with g = dU/dq",
    )
