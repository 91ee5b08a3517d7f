"""The recorder of the energies of the robot."""

from __future__ import annotations

from rrrgen.derive.functions.recording import Recorder, Recording
from rrrgen.derive.recursions import momentum
from rrrgen.program import Port, Program


def energy(r: Recording) -> Program:
    """Record E = [kinetic, potential] in J: dq' M dq / 2, and U with dU/dq = g, defined up to a constant."""
    chain = r.chain_in_gravity("dq")
    dq = r.joints("dq")
    inertias = r.inertias()
    kinetic = momentum.kinetic_energy(chain, dq, inertias)
    kinetic = r.drive_inertia().added_to_energy(kinetic, dq)
    potential = momentum.potential_energy(chain, inertias)
    port = Port("E", (2,), "J", "", "kinetic energy, potential energy (up to a constant)")
    return r.builder.program(
        "energy",
        [(port, [kinetic, potential])],
        "Kinetic and potential energy.",
        "E = [dq' M dq / 2, U(q)],  g = dU/dq",
    )


FUNCTIONS: dict[str, tuple[Recorder, ...]] = {"energy": (energy,)}
