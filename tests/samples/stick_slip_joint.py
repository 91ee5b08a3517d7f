"""A joint with friction under sampled control, integrated in small steps: the hidden truth of the tests.

Shares nothing with the package. The joint sticks exactly: at rest it stays there while the load is below break-away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

FINE = 2.0 * math.pi / 655360
COARSE = 2.0 * math.pi / 65536
SLOW = 0.1  # rad/s: slower motion of a LuGre joint can be integrated in smaller steps


@dataclass(frozen=True)
class Joint:
    """True parameters of one joint; ``law`` is stribeck, coulomb_viscous, asymmetric, tanh or lugre."""

    law: str = "stribeck"
    inertia: float = 0.066
    gravity: float = 1.65
    angle: float = 0.0  # gravity torque: gravity cos(q - angle)
    coulomb: float = 0.6
    coulomb_n: float = 0.6
    viscous: float = 0.12
    viscous_n: float = 0.12
    excess: float = 0.35
    speed: float = 0.08
    sigma0: float = 2e4
    sigma1: float = 20.0
    tanh: tuple[tuple[float, float], ...] = field(default=((0.6, 60.0), (0.35, 20.0), (-0.35, 8.0)))

    def level(self, v: float, direction: float) -> float:
        """Magnitude of the friction that is not viscous, sliding in ``direction``."""
        if self.law == "coulomb_viscous":
            return self.coulomb
        if self.law == "asymmetric":
            return self.coulomb if direction > 0 else self.coulomb_n
        return self.coulomb + self.excess * math.exp(-((v / self.speed) ** 2))

    def damping(self, direction: float) -> float:
        return self.viscous_n if self.law == "asymmetric" and direction < 0 else self.viscous


def reference(duration: float, period: float, seed: int, fast: float = 1.2, slow: float = 0.25):
    """Half a fast multisine (0.1-5 Hz), half a slow one (0.05-0.2 Hz) with reversals; rms speeds in rad/s."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(duration / period)) * period
    half = duration / 2.0
    dq = np.zeros_like(t)
    for low, high, rms, start in ((0.1, 5.0, fast, 0.0), (0.05, 0.2, slow, half)):
        f = np.arange(low, high + 1e-9, 0.05 if high < 1 else 0.1)
        phases = rng.uniform(0, 2 * math.pi, len(f))
        amplitude = rms * math.sqrt(2.0 / len(f))
        part = (t >= start) & (t < start + half)
        local = t[part] - start
        wave = (amplitude * np.cos(2 * math.pi * f * local[:, None] + phases)).sum(axis=1)
        fade = np.clip(np.minimum(local, half - local) / 0.5, 0, 1)
        dq[part] = wave * fade**2 * (3 - 2 * fade)
    q = np.concatenate([[0.0], np.cumsum(0.5 * (dq[1:] + dq[:-1])) * period])
    return t, q, dq


def record(
    joint: Joint,
    duration: float = 40.0,
    period: float = 1e-3,
    resolution: float = FINE,
    torque_noise: float = 0.0,
    delay: int = 0,
    seed: int = 0,
    substeps: int = 10,
    bandwidth: float = 6.0,
    centred: bool = False,
    motion=None,
    finer: int = 1,
):
    """t, q, tau (and reference) of the joint under PD control with backward differences; torque held over a sample.

    ``finer`` is the number of steps in place of one where the bristles of a LuGre joint stick and slip.
    """
    rng = np.random.default_rng(1000 + seed)
    t, qr, dqr = reference(duration, period, seed) if motion is None else motion
    omega = 2 * math.pi * bandwidth
    kp, kd = joint.inertia * omega**2, 2 * 0.8 * joint.inertia * omega
    noise = rng.normal(size=len(t)) * torque_noise
    h = period / substeps
    J, b, tanh_law, lugre = joint.inertia, joint.viscous, joint.law == "tanh", joint.law == "lugre"
    q = v = z = 0.0
    q = float(qr[0])
    before = q
    queue = [joint.gravity * math.cos(q - joint.angle)] * (delay + 1)
    Q, U, V = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t))
    for k in range(len(t)):
        seen = round(q / resolution) * resolution if resolution else q
        Q[k], V[k] = seen, v
        u = kp * (qr[k] - seen) + kd * (dqr[k] - (seen - before) / period)
        before = seen
        queue.append(u)
        U[k] = u
        held = queue[-1 - delay]
        for _ in range(substeps):
            load = held - joint.gravity * math.cos(q - joint.angle)
            if lugre:
                pieces = finer if abs(v) < SLOW else 1
                for _ in range(pieces):
                    q, v, z = _lugre_step(joint, load, q, v, z, h / pieces)
                continue
            if tanh_law:
                f0 = sum(f * math.tanh(w * v) for f, w in joint.tanh) + b * v
                slope = sum(f * w / math.cosh(min(w * abs(v), 50.0)) ** 2 for f, w in joint.tanh) + b
                dv = h * (load - f0) / J / (1 + h * max(slope, 0.0) / J)
                q += h * (v + 0.5 * dv)
                v += dv
                continue
            direction = math.copysign(1.0, v) if v else 0.0
            if not v:
                hold = joint.level(0.0, math.copysign(1.0, load))
                if abs(load) <= hold:
                    continue
                direction = math.copysign(1.0, load)
            a = (load - direction * joint.level(v, direction) - joint.damping(direction) * v) / J
            middle = v + 0.5 * h * a
            a = (load - direction * joint.level(middle, direction) - joint.damping(direction) * middle) / J
            new = v + h * a
            if new * direction < 0.0:  # stops within the step
                q += 0.5 * v * h * v / (v - new)
                v = 0.0
                continue
            q += 0.5 * h * (v + new)
            v = new
    recorded = U.copy()
    if centred:
        recorded = 0.5 * (U + np.concatenate([U[:1], U[:-1]]))
    return {"t": t, "q": Q, "tau": recorded + noise, "qr": qr, "dqr": dqr, "v": V}


def _lugre_step(joint: Joint, load: float, q: float, v: float, z: float, h: float):
    """Trapezoidal in (v, z), with the rate of forgetting of the last step."""
    g = joint.sigma0 * abs(v) / joint.level(v, 1.0)
    s0, s1, b, J = joint.sigma0, joint.sigma1, joint.viscous, joint.inertia
    z_old = z
    for _ in range(2):
        # z+ = z + h/2 (v - g z + v+ - g z+), J (v+ - v)/h = load - s0 (z + z+)/2 - s1 (z+ - z)/h - b (v + v+)/2
        c0 = (z_old + 0.5 * h * (v - g * z_old)) / (1 + 0.5 * h * g)
        c1 = 0.5 * h / (1 + 0.5 * h * g)
        rhs = J * v / h + load - s0 * (z_old + c0) / 2 - s1 * (c0 - z_old) / h - b * v / 2
        new = rhs / (J / h + s0 * c1 / 2 + s1 * c1 / h + b / 2)
        mean = 0.5 * (v + new)
        g = joint.sigma0 * abs(mean) / joint.level(mean, 1.0)
    z = c0 + c1 * new
    return q + 0.5 * h * (v + new), new, z


def bristles(joint: Joint, torque, period: float, substeps: int = 4):
    """Positions of a LuGre joint from rest under an open-loop torque held over each period."""
    q = v = z = 0.0
    found = np.zeros(len(torque))
    for k, held in enumerate(torque.tolist()):
        found[k] = q
        for _ in range(substeps):
            q, v, z = _lugre_step(joint, held, q, v, z, period / substeps)
    return found


def multisine(seed: int, level: float, break_away: float = 0.95, period: float = 1e-3, repeats: int = 6):
    """Two seconds of 1 to 250 Hz, repeated, with a peak of ``level`` of the break-away torque."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(2.0 / period)) * period
    wave = np.cos(2 * math.pi * np.arange(1, 251) * t[:, None] + rng.uniform(0, 2 * math.pi, 250)).sum(axis=1)
    return np.tile(level * break_away * wave / np.abs(wave).max(), repeats)
