"""Cases of the study ``independent.py``: joints, loops, motions, and the files in which their recordings are kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from oracles.sliding_joint import FINE, SampledLoop, SlidingJoint

ROBOTS = {"pendulum": ["q1"], "rrr": ["q1", "q2", "q3"], "gantry": ["q1", "q2", "q3"]}
DESIGNED = "designed"


@dataclass(frozen=True)
class Case:
    """A recorded joint: the truth, the loop, the motion of ``seconds``, and how ``robot`` and file describe it."""

    joint: SlidingJoint
    loop: SampledLoop = field(default_factory=SampledLoop)
    motion: str = DESIGNED
    fast: float = 1.2
    slow: float = 0.25
    seconds: float = 40.0
    file: str = "own columns"
    robot: str = "pendulum"
    moving: str = "q1"


def multisine(t: np.ndarray, low: float, high: float, spacing: float, rms: float, rng) -> np.ndarray:
    """Random-phase multisine of the frequencies low, low + spacing .. high, Hz."""
    f = np.arange(low, high + 1e-9, spacing)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(f))
    return sum(np.cos(2.0 * np.pi * a * t + b) for a, b in zip(f, phases, strict=True)) * rms / np.sqrt(len(f) / 2)


def eased(x: np.ndarray) -> np.ndarray:
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def reference(case: Case, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t, q, dq of the reference; q is centred."""
    T, rng = case.loop.period, np.random.default_rng(4711 + seed)
    t = np.arange(round(case.seconds / T)) * T
    dq = MOTIONS[case.motion](t, case, rng) * eased(t / 0.5)
    q = np.concatenate([[0.0], np.cumsum(0.5 * (dq[1:] + dq[:-1])) * T])
    return t, q - 0.5 * (q.max() + q.min()), dq


def _designed(t, case, rng):
    half = case.seconds / 2.0
    fast = multisine(t, 0.1, 5.0, 0.1, case.fast, rng) * eased((half - t) / 0.5)
    slow = multisine(t, 0.05, 0.2, 0.05, case.slow, rng) * eased((t - half) / 0.5)
    return np.where(t < half, fast, slow)


def _other_bands(t, case, rng):
    switch = 0.4 * case.seconds
    fast = multisine(t, 0.3, 3.0, 0.3, case.fast, rng) * eased(switch - t)
    return np.where(t < switch, fast, multisine(t, 0.02, 0.12, 0.02, case.slow, rng) * eased(t - switch))


def _fast_alone(t, case, rng):
    return multisine(t, 0.05, 4.0, 0.05, case.fast, rng)


def _together(t, case, rng):
    return multisine(t, 0.1, 5.0, 0.1, 0.5 * case.fast, rng) + multisine(t, 0.05, 0.2, 0.05, case.slow, rng)


def _chirp(t, case, rng):
    return 1.2 * case.fast * np.sin(2.0 * np.pi * (0.05 * t + 2.0 * t * t / case.seconds))


def _chirp_then_sine(t, case, rng):
    half = case.seconds / 2.0
    fast = 1.2 * case.fast * np.sin(2.0 * np.pi * (0.1 * t + 2.0 * t * t / half))
    return np.where(t < half, fast, case.slow * np.sin(0.2 * np.pi * (t - half)))


def _trapezoids(t, case, rng):
    """Constant speeds of seven levels in both directions, then two sines."""
    levels = np.repeat([0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.5], 2) * case.fast / 1.2
    each = 0.6 * case.seconds / len(levels)
    k = np.minimum((t // each).astype(int), len(levels) - 1)
    within = t - k * each
    trapezoids = levels[k] * np.where(k % 2, -1.0, 1.0) * np.clip(np.minimum(within, each - within) / 0.15, 0.0, 1.0)
    x = t - len(levels) * each
    sines = 0.7 * case.fast * (np.sin(2.2 * np.pi * x) + np.sin(6.6 * np.pi * x)) * eased(x / 0.5)
    return np.where(x < 0.0, trapezoids, sines)


def _triangles(t, case, rng):
    half = case.seconds / 2.0
    fast = case.fast * (np.sin(1.6 * np.pi * t) + 0.6 * np.sin(5.4 * np.pi * t))
    return np.where(t < half, fast, case.slow * np.sign(np.sin(0.3 * np.pi * (t - half))))


def _points(t, case, rng):
    """Moves of minimum jerk between random positions, quick ones and slow ones, with short rests."""
    dq, at, here = np.zeros_like(t), 0.2, 0.0
    while at < t[-1]:
        there = rng.uniform(-0.8, 0.8)
        peak = case.fast * 1.5 if rng.random() < 0.6 else case.slow * rng.uniform(0.1, 1.0)
        span = 1.875 * abs(there - here) / peak
        s = (t - at) / span
        inside = (s > 0.0) & (s < 1.0)
        dq[inside] = ((there - here) * 30.0 * s * s * (1.0 - s) ** 2 / span)[inside]
        at, here = at + span + rng.uniform(0.1, 0.4), there
    return dq


MOTIONS: dict[str, Callable] = {
    DESIGNED: _designed,
    "other bands": _other_bands,
    "fast alone": _fast_alone,
    "together": _together,
    "chirp": _chirp,
    "chirp, then sine": _chirp_then_sine,
    "trapezoids": _trapezoids,
    "triangles": _triangles,
    "points": _points,
}


def write(folder: Path, case: Case, found: dict[str, np.ndarray]) -> Path:
    """Write the recording to ``folder`` in the form that the case asks for; returns the file to pass as ``--log``."""
    names = ROBOTS[case.robot]
    if case.file == "own columns":
        still = np.zeros_like(found["t"])
        columns = {"t": found["t"]}
        columns |= {f"q_{name}": found["q"] if name == case.moving else still for name in names}
        columns |= {f"tau_{name}": found["tau"] if name == case.moving else still for name in names}
        table = np.column_stack(list(columns.values()))
        np.savetxt(folder / "log.csv", table, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
        return folder / "log.csv"
    (folder / "log.yaml").write_text(FILES[case.file](folder, case, found).replace("NAME", case.moving))
    return folder / "log.yaml"


def _save(folder: Path, columns: dict[str, np.ndarray], delimiter: str = ",") -> str:
    table = np.column_stack(list(columns.values()))
    header = delimiter.join(columns)
    np.savetxt(folder / "data.csv", table, delimiter=delimiter, header=header, comments="", fmt="%.10g")
    return "schema: rrrgen-log/1\nfiles: data.csv\n"


def _volts(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    counts = np.round(found["q"] / FINE)
    text = _save(folder, {"time": found["t"], "enc": counts, "volt": found["tau"] / 0.25}, ";")
    return text + (
        "time: {column: time, unit: s}\nunits: {position: rad, torque: V}\njoints:\n  - name: NAME\n"
        "    position: {column: enc, unit: counts, counts_per_turn: 655360}\n"
        "    torque: {column: volt, constant: 0.25 N*m/V}\n"
    )


def _degrees(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    text = _save(folder, {"ms": 1e3 * found["t"], "angle": np.rad2deg(found["q"]), "load": 1e3 * found["tau"]})
    return text + (
        "time: {column: ms, unit: ms}\nunits: {position: deg, torque: mN*m}\njoints:\n"
        "  - {name: NAME, position: angle, torque: load}\n"
    )


def _motor(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    """Motor angle behind a gear of 50 that turns the other way, current of either sign, time that starts late."""
    motor, current = -50.0 * (found["q"] - 0.3), -found["tau"] / 50.0 / 0.08
    text = _save(folder, {"clock": 17.25 + found["t"], "m": motor, "i": current, "x": found["v"]})
    return text + (
        "time: {column: clock, unit: s}\nunits: {position: rad, torque: A}\nside: motor\njoints:\n"
        "  - name: NAME\n    gear_ratio: 50\n    zero: 0.3\n    position: {column: m, sign: -1}\n"
        "    torque: {column: i, sign: -1, constant: 0.08 N*m/A}\n"
    )


def _reversed_gain(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    text = _save(folder, {"t": found["t"], "q": found["q"], "i": -found["tau"] / 1.7})
    return text + (
        "time: {column: t, unit: s}\nunits: {position: rad, torque: A}\njoints:\n"
        "  - {name: NAME, position: q, torque: {column: i, constant: -1.7 N*m/A}}\n"
    )


def _array(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    np.save(folder / "data.npy", np.column_stack([found["q"], found["tau"]]))
    return (
        f"schema: rrrgen-log/1\nfiles: data.npy\ntime: {{period: {1e3 * case.loop.period:.6g} ms}}\n"
        "units: {position: rad, torque: N*m}\njoints:\n  - {name: NAME, position: 1, torque: 2}\n"
    )


def _matlab(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    from scipy.io import savemat

    savemat(folder / "data.mat", {"q": found["q"][:, None], "u": found["tau"][:, None]})
    return (
        f"schema: rrrgen-log/1\nfiles: data.mat\ntime: {{rate: {1.0 / case.loop.period:.6g} Hz}}\n"
        "units: {position: rad, torque: N*m}\njoints:\n  - {name: NAME, position: 'q[0]', torque: 'u[0]'}\n"
    )


def _velocities(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    """Measured speeds and references are kept too, as a controller logs them."""
    columns = {"t": found["t"], "q": found["q"], "dq": found["v"], "tau": found["tau"], "ref": found["qr"]}
    return _save(folder, columns) + (
        "time: {column: t, unit: s}\nunits: {position: rad, velocity: rad/s, torque: N*m, reference: rad}\n"
        "joints:\n  - {name: NAME, position: q, velocity: dq, torque: tau, reference: ref}\n"
    )


def _lost_rows(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    """Two rows in a hundred were lost, and the clock is uncertain by a fiftieth of a period."""
    rng = np.random.default_rng(0)
    kept = rng.random(len(found["t"])) > 0.02
    t = found["t"] + 0.02 * case.loop.period * rng.normal(size=len(kept))
    text = _save(folder, {"t": t[kept], "q": found["q"][kept], "tau": found["tau"][kept]})
    return text + (
        "time: {column: t, unit: s}\nunits: {position: rad, torque: N*m}\njoints:\n"
        "  - {name: NAME, position: q, torque: tau}\n"
    )


def _millimetres(folder: Path, case: Case, found: dict[str, np.ndarray]) -> str:
    text = _save(folder, {"t": found["t"], "mm": 1e3 * found["q"], "N": found["tau"]})
    return text + (
        "time: {column: t, unit: s}\nunits: {position: mm, torque: N}\njoints:\n"
        "  - {name: NAME, position: mm, torque: 'N'}\n"
    )


FILES: dict[str, Callable[[Path, Case, dict[str, np.ndarray]], str]] = {
    "volts and counts": _volts,
    "degrees": _degrees,
    "motor side": _motor,
    "reversed gain": _reversed_gain,
    "array": _array,
    "matlab": _matlab,
    "velocities": _velocities,
    "lost rows": _lost_rows,
    "millimetres": _millimetres,
}

CV = SlidingJoint("coulomb_viscous")
ASYM = SlidingJoint("asymmetric", coulomb_n=0.45, viscous_n=0.2)
STRIBECK = SlidingJoint("stribeck")
LUGRE = SlidingJoint("lugre")
NEURAL = SlidingJoint("neural")
NOISY = SampledLoop(noise=0.02)
RRR1 = {"robot": "rrr", "moving": "q1"}
LIGHT = {"inertia": 0.01, "gravity": 0.0, "coulomb": 0.05, "excess": 0.03, "viscous": 0.01, "speed": 0.1}
LARGE = {"inertia": 0.8, "gravity": 12.0, "coulomb": 4.0, "excess": 2.0, "viscous": 1.5}
SLIDE = {"inertia": 12.0, "gravity": 0.0, "coulomb": 20.0, "excess": 9.0, "viscous": 45.0, "speed": 0.02}
MM = {"fast": 0.3, "slow": 0.06, "file": "millimetres", "robot": "gantry"}
MICRON = 1e-6

CASES: dict[str, Case] = {
    "coulomb_viscous": Case(CV),
    "asymmetric": Case(ASYM),
    "stribeck": Case(STRIBECK),
    "lugre": Case(LUGRE),
    "neural": Case(NEURAL),
    "coulomb_viscous, noise": Case(CV, NOISY),
    "asymmetric, noise": Case(SlidingJoint("asymmetric", coulomb_n=0.5, viscous_n=0.16), NOISY),
    "stribeck, noise": Case(STRIBECK, NOISY),
    "lugre, noise": Case(LUGRE, NOISY),
    "neural, noise": Case(NEURAL, NOISY),
    "stribeck, heavy": Case(
        SlidingJoint("stribeck", inertia=5.0, gravity=60.0, coulomb=12.0, excess=5.0, viscous=4.0, speed=0.05),
        SampledLoop(bandwidth=3.0),
    ),
    "stribeck, light": Case(SlidingJoint("stribeck", **LIGHT), SampledLoop(period=5e-4), **RRR1),
    "coulomb_viscous, light, 2 kHz": Case(SlidingJoint("coulomb_viscous", **LIGHT), SampledLoop(period=5e-4), **RRR1),
    "stribeck, 500 Hz": Case(STRIBECK, SampledLoop(period=2e-3, noise=0.01)),
    "stribeck, 5 kHz": Case(STRIBECK, SampledLoop(period=2e-4, noise=0.01)),
    "neural, 5 kHz": Case(NEURAL, SampledLoop(period=2e-4)),
    "lugre, 2 kHz": Case(
        SlidingJoint("lugre", sigma0=6e4, sigma1=40.0),
        SampledLoop(period=5e-4, noise=0.005),
    ),
    "lugre, 500 Hz, offset": Case(
        SlidingJoint("lugre", sigma0=1e4, sigma1=15.0, constant=0.05), SampledLoop(period=2e-3)
    ),
    "stribeck, fast alone": Case(STRIBECK, motion="fast alone"),
    "stribeck, together": Case(STRIBECK, motion="together"),
    "stribeck, other bands": Case(STRIBECK, NOISY, motion="other bands"),
    "stribeck, chirp, then sine": Case(STRIBECK, motion="chirp, then sine"),
    "stribeck, chirp": Case(STRIBECK, motion="chirp"),
    "stribeck, trapezoids": Case(STRIBECK, SampledLoop(noise=0.01), motion="trapezoids"),
    "stribeck, triangles": Case(STRIBECK, motion="triangles"),
    "stribeck, points": Case(STRIBECK, SampledLoop(noise=0.01), motion="points"),
    "asymmetric, trapezoids": Case(
        SlidingJoint("asymmetric", coulomb_n=0.5, viscous_n=0.15), SampledLoop(noise=0.01), motion="trapezoids"
    ),
    "asymmetric, points": Case(ASYM, SampledLoop(noise=0.01), motion="points"),
    "coulomb_viscous, chirp": Case(CV, motion="chirp"),
    "coulomb_viscous, fast alone, noise": Case(CV, SampledLoop(noise=0.03), motion="fast alone"),
    "coulomb_viscous, points": Case(CV, SampledLoop(noise=0.01), motion="points"),
    "lugre, points": Case(LUGRE, SampledLoop(noise=0.005), motion="points"),
    "neural, points": Case(NEURAL, SampledLoop(noise=0.005), motion="points"),
    "asymmetric, small difference": Case(SlidingJoint("asymmetric", coulomb_n=0.57), SampledLoop(noise=0.01)),
    "stribeck, delay and feedforward": Case(
        STRIBECK, SampledLoop(delay=1, feedforward=True, bandwidth=10.0, noise=0.01)
    ),
    "stribeck, integral part": Case(
        SlidingJoint("stribeck", **LARGE), SampledLoop(integral=2.0), robot="rrr", moving="q2"
    ),
    "stribeck, cascade": Case(STRIBECK, SampledLoop(cascade=True, integral=0.2, noise=0.005), motion="other bands"),
    "stribeck, saturation": Case(STRIBECK, SampledLoop(limit=2.4, noise=0.0), fast=2.0),
    "stribeck, saturation, noise": Case(STRIBECK, SampledLoop(limit=2.4, noise=0.01), fast=2.0),
    "stribeck, current of 10 bits": Case(STRIBECK, SampledLoop(step=0.01)),
    "stribeck, volts and counts": Case(STRIBECK, SampledLoop(noise=0.01), file="volts and counts"),
    "stribeck, degrees": Case(STRIBECK, SampledLoop(noise=0.005), file="degrees"),
    "asymmetric, motor side": Case(ASYM, SampledLoop(noise=0.01), file="motor side"),
    "stribeck, reversed gain": Case(STRIBECK, SampledLoop(noise=0.01), file="reversed gain"),
    "coulomb_viscous, array": Case(CV, SampledLoop(noise=0.01), file="array"),
    "stribeck, matlab": Case(STRIBECK, SampledLoop(noise=0.01), file="matlab"),
    "lugre, velocities": Case(LUGRE, file="velocities"),
    "stribeck, lost rows": Case(STRIBECK, SampledLoop(noise=0.01), file="lost rows"),
    "neural, no gravity": Case(SlidingJoint("neural", gravity=0.0), **RRR1),
    "neural, soft": Case(SlidingJoint("neural", force=(0.6, 0.2, -0.1), steepness=(30.0, 8.0, 2.0))),
    "stribeck, large excess": Case(SlidingJoint("stribeck", excess=0.6, speed=0.03), SampledLoop(noise=0.01)),
    "stribeck, disturbed": Case(STRIBECK, SampledLoop(disturbance=0.02)),
    "stribeck, 200000 counts": Case(STRIBECK, SampledLoop(resolution=2.0 * np.pi / 200000)),
    "lugre, soft": Case(SlidingJoint("lugre", sigma0=5e3, sigma1=5.0)),
    "lugre, stiff": Case(SlidingJoint("lugre", sigma0=1e5, sigma1=60.0)),
    "stribeck, offset": Case(SlidingJoint("stribeck", constant=0.3), NOISY),
    "asymmetric, as by an offset": Case(SlidingJoint("asymmetric", coulomb=0.7, coulomb_n=0.5), NOISY),
    "stribeck, no gravity, offset": Case(SlidingJoint("stribeck", gravity=0.0, constant=0.05), NOISY, **RRR1),
    "coulomb_viscous, no gravity, offset": Case(
        SlidingJoint("coulomb_viscous", gravity=0.0, constant=0.05), NOISY, **RRR1
    ),
    "stribeck, hanging elsewhere": Case(SlidingJoint("stribeck", hang=1.9), NOISY),
    "stribeck, hardly faster than its speed": Case(SlidingJoint("stribeck", hang=0.4), NOISY, fast=0.3, slow=0.06),
    "stribeck, prismatic": Case(
        SlidingJoint("stribeck", **SLIDE), SampledLoop(resolution=MICRON, noise=0.3), moving="q1", **MM
    ),
    "coulomb_viscous, prismatic with weight": Case(
        SlidingJoint("coulomb_viscous", **SLIDE | {"constant": 110.0}),
        SampledLoop(resolution=MICRON, noise=0.3),
        moving="q3",
        **MM,
    ),
}
