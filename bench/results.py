"""The results of one run, and look-ups in them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from bench.contenders.contender import OURS_FILE, PINOCCHIO
from bench.measurements.batches import BatchTime
from bench.measurements.control_tick import TickTime
from bench.measurements.generation import Generation
from bench.measurements.inverse_kinematics import IKScore
from bench.measurements.path_timing import PathTime
from bench.measurements.python_calls import CallTime
from bench.measurements.race import Score
from bench.measurements.second_derivatives import SecondTime
from bench.measurements.trees import TreeTime


@dataclass
class Results:
    """One run of the benchmark."""

    machine: str
    compiler: str
    peers: dict[str, str]
    effort: str
    scores: list[Score] = field(default_factory=list)
    calls: list[CallTime] = field(default_factory=list)
    batches: dict[str, BatchTime] = field(default_factory=dict)
    ik: list[IKScore] = field(default_factory=list)
    growth: list[Score] = field(default_factory=list)
    derivations: list[float] = field(default_factory=list)
    generations: list[Generation] = field(default_factory=list)
    ticks: list[TickTime] = field(default_factory=list)
    paths: list[PathTime] = field(default_factory=list)
    mechanisms: list[TreeTime] = field(default_factory=list)
    hessians: list[SecondTime] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def score(self, robot: str, function: str, label: str) -> Score | None:
        """The score of one contender; None if it was not measured."""
        for score in self.scores:
            if (score.robot, score.contender.function, score.contender.label) == (robot, function, label):
                return score
        return None

    def batch_ratio(self, robot: str) -> float | None:
        """The time of one state in a batch, relative to a call of Pinocchio."""
        own, rival = (self.score(robot, "inverse_dynamics", label) for label in (OURS_FILE, PINOCCHIO))
        if own is None or rival is None or robot not in self.batches:
            return None
        # noise changes between races, so both ratios are of times taken in turns
        times = self.batches[robot]
        return times.batch / times.single * own.nanoseconds / rival.nanoseconds

    def robots(self) -> list[str]:
        """Robots that were measured, in order."""
        return list(dict.fromkeys(score.robot for score in self.scores))

    def call(self, robot: str, interface: str) -> float | None:
        """Nanoseconds of a Python call."""
        return next((c.nanoseconds for c in self.calls if (c.robot, c.interface) == (robot, interface)), None)

    def as_dict(self) -> dict[str, Any]:
        """The results as plain data for JSON."""
        return {
            "machine": self.machine,
            "compiler": self.compiler,
            "peers": self.peers,
            "effort": self.effort,
            "functions": [_plain(score) for score in self.scores],
            "python_calls": [asdict(call) for call in self.calls],
            "batch_nanoseconds_per_state": {robot: asdict(times) for robot, times in self.batches.items()},
            "inverse_kinematics": [asdict(score) for score in self.ik],
            "growth": [_plain(score) for score in self.growth],
            "growth_derivation_seconds": self.derivations,
            "generation": [asdict(each) for each in self.generations],
            "control_ticks": [asdict(each) for each in self.ticks],
            "path_timings": [asdict(each) for each in self.paths],
            "mechanisms": [asdict(each) for each in self.mechanisms],
            "hessians": [asdict(each) for each in self.hessians],
            "left_out": self.left_out,
        }


def _plain(score: Score) -> dict[str, Any]:
    contender = score.contender
    return {
        "robot": score.robot,
        "function": contender.function,
        "contender": contender.label,
        "nanoseconds": score.nanoseconds,
        "instructions": score.instructions,
        "operations": contender.operations,
        "deviation": score.deviation,
    }


def work(score: Score) -> float:
    """The instructions per call; nanoseconds if instructions could not be counted."""
    return score.nanoseconds if score.instructions is None else score.instructions
