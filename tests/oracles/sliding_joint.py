"""A joint with friction under a sampled controller, integrated in C by an own method: recordings with known truth.

Stands beside ``samples/stick_slip_joint.py``, which has another integrator and controller; neither shares code with the
package or with the other.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

FINE = 2.0 * math.pi / 655360
LAWS = ("coulomb_viscous", "asymmetric", "stribeck", "lugre", "neural")


@dataclass(frozen=True)
class SlidingJoint:
    """True parameters; the load is ``gravity sin(q - hang) + constant``, so the joint hangs at rest at ``hang``."""

    law: str
    inertia: float = 0.066
    gravity: float = 1.65
    hang: float = 0.0
    constant: float = 0.0
    coulomb: float = 0.6
    coulomb_n: float = 0.6
    viscous: float = 0.12
    viscous_n: float = 0.12
    excess: float = 0.35
    speed: float = 0.08
    sigma0: float = 2e4
    sigma1: float = 20.0
    force: tuple[float, float, float] = (0.5, 0.4, -0.2)
    steepness: tuple[float, float, float] = (80.0, 15.0, 4.0)

    def truth(self) -> dict[str, float]:
        """Parameters that an estimate of the right law reports, by the names that it gives them."""
        found = {"inertia": self.inertia, "gravity": self.gravity}
        if self.gravity:
            found |= {"gravity_angle": math.remainder(self.hang + math.pi / 2.0, 2.0 * math.pi)}
        else:
            found["gravity"] = self.constant
        found["offset"] = self.constant
        if self.law == "asymmetric":
            found |= {"coulomb_p": self.coulomb, "coulomb_n": self.coulomb_n}
            return found | {"viscous_p": self.viscous, "viscous_n": self.viscous_n}
        found["viscous"] = self.viscous
        if self.law != "neural":
            found["coulomb"] = self.coulomb
        if self.law in ("stribeck", "lugre"):
            found |= {"stiction_excess": self.excess, "stribeck_speed": self.speed}
        if self.law == "lugre":
            found |= {"sigma0": self.sigma0, "sigma1": self.sigma1}
        return found

    def friction(self, v: np.ndarray) -> np.ndarray:
        """Friction torque at the constant speeds ``v``."""
        if self.law == "asymmetric":
            return np.where(v > 0, self.coulomb + self.viscous * v, self.viscous_n * v - self.coulomb_n)
        if self.law == "neural":
            pairs = zip(self.force, self.steepness, strict=True)
            return self.viscous * v + sum(f * np.tanh(w * v) for f, w in pairs)
        excess = 0.0 if self.law == "coulomb_viscous" else self.excess
        return np.sign(v) * (self.coulomb + excess * np.exp(-((v / self.speed) ** 2))) + self.viscous * v


@dataclass(frozen=True)
class SampledLoop:
    """Controller, encoder and drive: PD of ``bandwidth`` (Hz) and ``damping``, with an integral part on request.

    ``cascade`` makes it a proportional position loop around a speed loop. ``limit`` is the torque limit, ``delay`` that
    of the torque in samples, ``disturbance`` the standard deviation of an unrecorded white torque, ``noise`` that of
    the recorded torque, ``step`` the resolution of the recorded torque.
    """

    period: float = 1e-3
    resolution: float = FINE
    bandwidth: float = 6.0
    damping: float = 0.8
    integral: float = 0.0
    cascade: bool = False
    feedforward: bool = False
    limit: float = 0.0
    delay: int = 0
    disturbance: float = 0.0
    noise: float = 0.0
    step: float = 0.0


@cache
def _library() -> ctypes.CDLL:
    folder = tempfile.mkdtemp(prefix="sliding_joint_")
    source, target = Path(__file__).with_suffix(".c"), Path(folder) / "sliding_joint.so"
    cc = shutil.which("cc") or shutil.which("gcc") or "cc"
    subprocess.run([cc, "-O2", "-shared", "-fPIC", str(source), "-o", str(target), "-lm"], check=True)
    library = ctypes.CDLL(str(target))
    shutil.rmtree(folder)
    return library


def simulate(joint: SlidingJoint, loop: SampledLoop, motion, seed: int = 0) -> dict[str, np.ndarray]:
    """t, q, tau, qr, dqr and true speed v of the joint that follows ``motion``, the reference (t, q, dq)."""
    t, q_ref, dq_ref = (np.ascontiguousarray(part, float) for part in motion)
    rng, n = np.random.default_rng(90_000 + seed), len(t)
    omega = 2.0 * math.pi * loop.bandwidth
    kp, kd = joint.inertia * omega**2, 2.0 * loop.damping * joint.inertia * omega
    wanted = np.zeros(n)
    if loop.feedforward:  # a rough model: three quarters of the friction
        wanted = joint.inertia * np.gradient(dq_ref, loop.period) + joint.gravity * np.sin(q_ref - joint.hang)
        wanted = wanted + 0.75 * joint.coulomb * np.tanh(dq_ref / 0.02)
    plant = (ctypes.c_double * 19)(
        LAWS.index(joint.law), joint.inertia, joint.gravity, joint.hang, joint.constant,
        joint.coulomb, joint.coulomb_n, joint.viscous, joint.viscous_n, joint.excess, joint.speed,
        joint.sigma0, joint.sigma1, *joint.force, *joint.steepness,
    )  # fmt: skip
    control = (ctypes.c_double * 7)(
        kp, kd, loop.integral * kp, float(loop.cascade), loop.resolution, loop.limit, loop.delay
    )  # fmt: skip
    disturbance = rng.normal(size=n) * loop.disturbance
    out = [np.zeros(n) for _ in range(3)]
    arrays = [q_ref, dq_ref, wanted, disturbance, *out]
    pointers = [each.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for each in arrays]
    _library().record(plant, control, n, ctypes.c_double(loop.period), _substeps(joint, loop.period, dq_ref), *pointers)
    q, u, v = out
    tau = u + rng.normal(size=n) * loop.noise
    if loop.step:
        tau = np.round(tau / loop.step) * loop.step
    return {"t": t, "q": q, "tau": tau, "qr": q_ref, "dqr": dq_ref, "v": v}


def _substeps(joint: SlidingJoint, period: float, speed: np.ndarray) -> int:
    """Steps within a sample: at most 20 us, and shorter than the quickest decay of bristles or of a steep law."""
    step = 2e-5
    if joint.law == "lugre":
        fastest = 3.0 * float(np.max(np.abs(speed)))
        step = min(step, joint.coulomb / (joint.sigma0 * fastest), 0.5 * joint.inertia / joint.sigma1)
        step = min(step, 0.3 * math.sqrt(joint.inertia / joint.sigma0))
    if joint.law == "neural":
        rate = sum(abs(f) * w for f, w in zip(joint.force, joint.steepness, strict=True)) / joint.inertia
        step = min(step, 0.5 / rate)
    return max(1, math.ceil(period / step))
