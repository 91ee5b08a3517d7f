"""The recorder of the energies of the robot."""

from __future__ import annotations

from rrrgen.derive.functions.recording import Recording
from rrrgen.derive.recursions import energy_and_momentum as momentum
from rrrgen.program import Port, Program


def energy(r: Recording) -> Program:
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
