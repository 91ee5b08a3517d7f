"""A swing of an arm with the least torques, by IPOPT: exact Hessians against Gauss-Newton and quasi-Newton.

    python examples/swing/run.py

The arm moves within its torque limits. Direct collocation by the implicit midpoint rule: states at the ends of the
intervals, torques constant between them. The objective is a sum of squares of the torques, so that Gauss-Newton has its
exact Hessian, and leaves out the curvature of the dynamics, which the multipliers weight. Prints for each method
iterations, time, and the time that evaluations of the Hessian took.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

import rrrgen

METHODS = {
    "rrrgen": "exact Hessian, functions of rrrgen",
    "casadi": "exact Hessian, derived by CasADi",
    "gauss-newton": "Gauss-Newton",
    "quasi-newton": "quasi-Newton (L-BFGS)",
}


class Swing(NamedTuple):
    """The motion: robot, number of intervals, duration in s, positions at both ends in rad."""

    robot: str
    intervals: int
    duration: float
    start: tuple[float, ...]
    end: tuple[float, ...]


MOTIONS = {
    "planar2r": Swing("planar2r", 40, 1.5, (-np.pi / 2, 0.0), (np.pi / 2, 0.0)),
    "rrr": Swing("rrr", 40, 1.0, (0.0, -np.pi / 2, 0.0), (1.5, np.pi / 2, 0.0)),
    "panda": Swing("panda", 30, 1.5, (0.0, 0.5, 0.0, -1.5, 0.0, 1.8, 0.0), (1.2, -0.6, 0.5, -2.2, 1.0, 2.5, 0.7)),
}


def solve(swing: Swing, method: str, most: int) -> dict[str, Any]:
    """Solve the problem by one of ``METHODS`` in at most ``most`` iterations; returns what IPOPT says of it."""
    m = rrrgen.compile(swing.robot, backend="numpy")
    forward = m.casadi_function("forward_dynamics_nominal", hessian=method != "casadi")
    n, N, h = m.n, swing.intervals, swing.duration / swing.intervals
    x = ca.MX.sym("x", 2 * n * (N + 1) + n * N)
    X = ca.reshape(x[: 2 * n * (N + 1)], 2 * n, N + 1)
    U = ca.reshape(x[2 * n * (N + 1) :], n, N)
    gaps = [X[:, 0] - ca.DM([*swing.start, *[0] * n]), X[:, N] - ca.DM([*swing.end, *[0] * n])]
    for k in range(N):
        middle = (X[:, k] + X[:, k + 1]) / 2
        ddq = forward(middle[:n], middle[n:], U[:, k])[0]
        gaps.append(X[:, k + 1] - X[:, k] - h * ca.vertcat(middle[n:], ddq))
    g, torques = ca.vertcat(*gaps), ca.vec(U)
    options: dict[str, Any] = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-6}
    options["ipopt.max_iter"] = most
    if method == "gauss-newton":
        J, factor, multipliers = ca.jacobian(torques, x), ca.MX.sym("f"), ca.MX.sym("g", g.numel())
        hessian, none = ca.triu(2 * h * factor * J.T @ J), ca.MX.sym("p", 0)
        names = ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        options["hess_lag"] = ca.Function("nlp_hess_l", [x, none, factor, multipliers], [hessian], *names)
    elif method == "quasi-newton":
        options["ipopt.hessian_approximation"] = "limited-memory"
    solver = ca.nlpsol("solver", "ipopt", {"x": x, "f": h * ca.sumsqr(torques), "g": g}, options)
    line = np.linspace(np.r_[swing.start, np.zeros(n)], np.r_[swing.end, np.zeros(n)], N + 1)
    limit = np.r_[np.full(line.size, np.inf), np.tile(m.limits.torque, N)]
    start = time.perf_counter()
    result = solver(x0=np.r_[line.ravel(), np.zeros(n * N)], lbx=-limit, ubx=limit, lbg=0, ubg=0)
    return {**solver.stats(), "time": time.perf_counter() - start, "effort": float(result["f"])}


def main() -> int:
    """Run the study; returns 1 unless both exact Hessians lead to a motion of the same effort."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", choices=MOTIONS, default="rrr", help="the arm (rrr)")
    parser.add_argument("--intervals", type=int, help="intervals of time (40, or 30 for the panda)")
    parser.add_argument("--most", type=int, default=300, help="most iterations of each method (300)")
    arguments = parser.parse_args()
    swing = MOTIONS[arguments.robot]
    swing = swing._replace(intervals=arguments.intervals or swing.intervals)
    print(f"{swing.robot}, {swing.intervals} intervals in {swing.duration} s")
    print(f"{'':36}{'iterations':>11}{'time':>9}{'Hessian':>10}{'effort':>9}")
    found = {}
    for method, title in METHODS.items():
        found[method] = r = solve(swing, method, arguments.most)
        hessian = r.get("t_wall_nlp_hess_l", 0) * 1e3
        effort = f"{r['effort']:.2f}" if r["success"] else "none"
        print(f"{title:36}{r['iter_count']:11}{r['time']:7.2f} s{hessian:7.1f} ms{effort:>9}")
    one, other = found["rrrgen"], found["casadi"]
    same = one["success"] and other["success"] and abs(one["effort"] / other["effort"] - 1) < 1e-4
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
