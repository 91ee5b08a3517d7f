"""Energies of the robot, recorded as a program."""

from __future__ import annotations

from rrrgen.derive.functions.recording import Recorder, Recording
from rrrgen.derive.recursions import momentum
from rrrgen.program import Port, Program


def energy(r: Recording) -> Program:
    """Kinetic and potential energy."""
    chain = r.chain()
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
