"""Check that forward dynamics reports a mass matrix that is not positive definite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rrrgen.verify.comparison import Check, Tolerances
from rrrgen.verify.references.numeric_robot import Array
from rrrgen.verify.subject import States

ASKED = 5  # states with an indefinite M at which the model is evaluated, one by one
INDEFINITE = 1e-3
"""M counts as indefinite if an eigenvalue is below minus this fraction of the largest. Closer to zero M is nearly
singular, and round-off decides whether an error is raised."""


def is_definite(M: Array, tolerances: Tolerances) -> NDArray[np.bool_]:
    """Mask (N,) of the states where M (N, n, n) is positive definite by more than round-off."""
    eigenvalues = np.linalg.eigvalsh(M)
    return np.asarray(eigenvalues[:, 0] > 0.1 * tolerances.exact * np.abs(eigenvalues[:, -1]), dtype=bool)


Ask = Callable[[Array, Array, Array], Array]


def check_refusal(function: str, check: Check, ask: Ask, s: States, M: Array) -> None:
    """Check that forward dynamics ``ask(q, dq, tau)`` raises an error at states where M (N, n, n) is indefinite.

    Where M is singular within round-off, it may raise the error or return finite accelerations.
    """

    def wrong() -> Array:
        return np.array([_answers_wrongly(ask, s, M, k) for k in range(min(ASKED, s.count))], dtype=np.float64)

    check(f"{function} refuses an indefinite M", wrong, np.zeros(min(ASKED, s.count)), scale=1.0)


def _answers_wrongly(ask: Ask, s: States, M: Array, k: int) -> bool:
    eigenvalues = np.linalg.eigvalsh(M[k])
    try:
        ddq = ask(s.q[k : k + 1], s.dq[k : k + 1], np.ones_like(s.q[k : k + 1]))
    except (np.linalg.LinAlgError, ArithmeticError):
        return False
    indefinite = eigenvalues[0] < -INDEFINITE * np.max(np.abs(eigenvalues))
    return bool(indefinite) or not np.all(np.isfinite(ddq))
