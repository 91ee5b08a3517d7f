"""Verification of a compiled model: every public function against independent references."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, cast

import numpy as np

from rrrgen.base.errors import DerivationError
from rrrgen.verify.against_newton_euler import (
    check_dynamics,
    check_floating_base,
    check_floating_second_derivatives,
    check_friction,
    check_kinematics,
    check_loops,
    check_regressors,
    check_tip,
)
from rrrgen.verify.identities import (
    check_derivatives,
    check_identities,
    check_parameters,
    check_second_derivatives,
)
from rrrgen.verify.inverse_kinematics import Tell, check_inverse_kinematics
from rrrgen.verify.optional_functions import check_optional_functions, check_optional_kinematics
from rrrgen.verify.references.libraries import LIBRARIES, ClosedReference, ReferenceUnavailableError
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, chain_of
from rrrgen.verify.report import DOUBLE, SINGLE, Collector, Report
from rrrgen.verify.subject import Case, InertialParameters, SplitCalls, States, draw_states, parameter_sets

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

LIBRARY_SAMPLES = (
    20  # states for other libraries, which evaluate one at a time; the Robotics Toolbox takes milliseconds
)


def verify(
    model: Model,
    samples: int = 200,
    seed: int = 0,
    *,
    libraries: bool = True,
    hessians: bool = False,
    optional: Collection[str] = (),
    tell: Tell | None = None,
) -> Report:
    """Compare every function of a model with independent references at random states.

    References: the built-in Newton-Euler (always), Pinocchio, MuJoCo and the Robotics Toolbox (when installed and
    ``libraries``), and identities among the model's own functions. Parameters: the description's links where it has
    them, and a random physical set handed over as ``beta``.

    A difference is ``max|a - b| / scale`` over all entries of all states. The scale is ``max|b|``, except where b may
    vanish identically: torque-like results (c, g, C'dq) are taken relative to the largest torque of the same states,
    energies to the largest energy, ``dJ/dt dq`` to ``max|J| max|dq|^2`` when that is larger, the skew-symmetry residue
    to ``max|M| max|dq|``. Accelerations from the forward dynamics are put back into the torque, so that an
    ill-conditioned M does not count against the model. Potential energies are compared up to their value at q = 0,
    because base parameters do not determine the constant. A model that answers in float32 is held to the tolerances of
    single precision, at states that float32 represents exactly. With ``hessians`` the second derivatives of the group
    "hessian" are derived and compared too. ``optional`` are names of emitted functions of other groups to compare.

    The inverse kinematics, which is evaluated in double, is compared with forward kinematics of the verifier's own and
    with a numerical search; see :func:`rrrgen.verify.inverse_kinematics.check_inverse_kinematics`. ``tell(done, total,
    message)`` is called with its progress.
    """
    if samples < 1:
        raise ValueError(f"samples must be at least 1, got {samples}")
    rng = np.random.default_rng(seed)
    model.engine.prepare()
    single_model = model
    model = cast("Model", SplitCalls(model))
    chain = chain_of(model.spec)
    states = draw_states(chain, samples, rng)
    single = _answers_in_single(model, states)
    tolerances = SINGLE if single else DOUBLE
    if single:
        states = states.round_to(np.float32)
    sets = parameter_sets(model, rng)
    rows = Collector()
    geometry = NewtonEuler(chain, sets[-1].phi)
    check_kinematics(model, geometry, states, tolerances, rows)
    check_regressors(model, geometry, states, tolerances, rows)
    check_parameters(model, geometry, states, np.random.default_rng(seed), tolerances, rows)
    check_loops(model, geometry, states, tolerances, rows)
    tips = {tip: chain_of(model.spec.at_tip(tip)) for tip in model.spec.tips} if optional else {}

    def of_tips(phi: Array) -> list[tuple[str, NewtonEuler]]:
        return [(tip, NewtonEuler(other, phi)) for tip, other in tips.items()]

    plain = InertialParameters("-", sets[-1].phi, sets[-1].beta)
    by_geometry = Case(model, geometry, plain, states, tolerances, rows)
    check_optional_kinematics(by_geometry, optional, of_tips(plain.phi))
    check_friction(model, states, tolerances, rows)
    for parameters in sets:
        case = Case(model, NewtonEuler(chain, parameters.phi), parameters, states, tolerances, rows)
        check_dynamics(case)
        check_floating_base(case)
        check_derivatives(case)
        if hessians:
            check_second_derivatives(case)
            check_floating_second_derivatives(case)
        check_optional_functions(case, optional, of_tips(parameters.phi))
        check_identities(case)
    check_inverse_kinematics(single_model, chain, samples, rng, rows, tell)
    for tip in model.spec.tips:
        one = NewtonEuler(chain_of(model.spec.at_tip(tip)), sets[-1].phi)
        try:
            arm = single_model.tip_arm(tip)
        except DerivationError as reason:
            check_tip(model, one, tip, None, states, tolerances, rows)
            rows.skipped.append((f"{tip}_inverse_kinematics", str(reason)))
            continue
        check_tip(model, one, tip, arm.carrier if arm.shared else None, states, tolerances, rows)
        check_inverse_kinematics(single_model, chain_of(arm.spec), samples, rng, rows, tell, tip)
    if libraries:
        for name in LIBRARIES:
            for parameters in sets:
                reference, few = NewtonEuler(chain, parameters.phi), states.first(LIBRARY_SAMPLES)
                _check_library(name, Case(model, reference, parameters, few, tolerances, rows))
    return Report(chain.name, samples, seed, tuple(rows.rows), tuple(dict.fromkeys(rows.skipped)))


def _answers_in_single(model: Model, states: States) -> bool:
    """Whether the model returns poses as float32; False if it raises, which another check reports."""
    try:
        return bool(np.asarray(model.forward_kinematics(states.q)).dtype == np.float32)
    except Exception:
        return False


def _check_library(name: str, case: Case) -> None:
    """Compare torques, mass matrix and pose of the tip with another library."""
    model, s, beta, chain, phi = case.model, case.s, case.beta, case.ne.chain, case.parameters.phi
    try:
        make = LIBRARIES[name]
        library = ClosedReference(make, chain, phi) if chain.loops else make(chain, phi)
    except ReferenceUnavailableError as reason:
        case.rows.skipped.append((name, str(reason)))
        return
    check = case.against(library.name, case.tolerances.foreign)
    tau = np.stack([library.inverse_dynamics(*state) for state in zip(s.q, s.dq, s.ddq, strict=True)])
    check("inverse_dynamics", lambda: model.inverse_dynamics(s.q, s.dq, s.ddq, beta=beta), tau)
    M = np.stack([library.mass_matrix(q) for q in s.q])
    check("mass_matrix", lambda: model.mass_matrix(s.q, beta=beta), M)
    tips = np.stack([library.forward_kinematics(q) for q in s.q])
    check("forward_kinematics", lambda: model.forward_kinematics(s.q), tips)
