"""What the errors on held-out data leave beyond noise: growth over the fitted data, and errors that follow each other.

A relative error says how large the held-out errors are, not whether noise explains them. Two tests say it for every
output. The mean squared error of held-out blocks of time is compared with that of fitted ones. And the error is
predicted linearly from earlier errors, farther back than the filters reach: noise of a sensor is not predictable.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.statistics import lagged_products
from rrrgen.lab.estimate.tsqr import Rows

BLOCK = 0.5  # s: errors of different blocks count as independent in the comparison of mean squares
FEWEST_BLOCKS = 6  # on either side of that comparison
EARLIER = 6  # earlier errors from which one is predicted
GROWN = 1.25  # ratio of held-out to fitted RMS error from which on a growth is worth a note
LATER = 0.15  # s: after this time errors share no noise of a sensor, not even one that a controller has passed on
FOLLOWS = 0.2  # share of the squares that earlier errors predict from which on it is worth a note
UNLIKELY = 1e-3  # probability, without anything left, of a growth or a share that is noted
NEGLIGIBLE = 1e-3  # relative error of an output below which nothing is said


@dataclass(frozen=True)
class Piece:
    """Consecutive samples of n outputs: times ``t`` (N,) in s, ``measured`` (N, n) and their prediction ``errors``.

    Errors are (N, n), NaN where an output is left out; ``segment`` (N,) is the number of the uninterrupted stretch.
    """

    t: Array
    measured: Array
    errors: Array
    segment: NDArray[np.int64]


def row_pieces(blocks: Iterable[Rows], theta: Array) -> Iterable[Piece]:
    """The errors ``tau - W theta`` of ``blocks`` of rows, for the parameters ``theta`` (p,) of all columns."""
    for rows in blocks:
        yield Piece(rows.t, rows.tau, np.where(rows.use, rows.tau - rows.W @ theta, np.nan), rows.segment)


@dataclass(frozen=True, eq=False)
class Errors:
    """Sums over the prediction errors of n outputs.

    ``products`` and ``pairs`` (EARLIER + 1, n) are the sums of ``e_k e_(k-l)`` and their numbers of pairs, for the lags
    l = 0, 1, ... times ``apart`` samples of ``period`` s; ``squares`` and ``counts`` (B, n) those of every block of
    time; ``size`` (n,) is the sum of the squared measured values.
    """

    period: float
    apart: int
    products: Array
    pairs: NDArray[np.int64]
    squares: Array
    counts: NDArray[np.int64]
    size: Array

    @classmethod
    def of(cls, pieces: Iterable[Piece], reach: int = 0) -> Errors | None:
        """Sum up ``pieces`` in order of time; filters mix the noise of samples up to ``reach`` from each other.

        None without any error.
        """
        period, apart = 0.0, 1
        total: list[Array] | None = None
        blocks: dict[tuple[int, int], Array] = {}
        tail: Array | None = None
        tail_segment: NDArray[np.int64] = np.zeros(0, np.int64)
        for piece in pieces:
            errors, segment, new = piece.errors, piece.segment, len(piece.errors)
            if period == 0.0 and new > 1:
                period = float(np.median(np.diff(piece.t)))
                apart = max(1 + reach, int(np.ceil(LATER / period - 1e-6)))
            present = np.isfinite(errors)
            squares = np.where(present, errors, 0.0) ** 2
            keys = np.column_stack([segment, np.floor(piece.t / BLOCK).astype(np.int64)])
            known, number = np.unique(keys, axis=0, return_inverse=True)
            sums = np.zeros((len(known), 2, squares.shape[1]))
            np.add.at(sums, number.reshape(-1), np.stack([squares, present], axis=1))
            for (stretch, block), increment in zip(known.tolist(), sums, strict=True):
                blocks[stretch, block] = blocks.get((stretch, block), 0.0) + increment
            if tail is not None:
                errors, segment = np.vstack([tail, errors]), np.concatenate([tail_segment, segment])
            parts = [lagged_products(column, segment, EARLIER, len(errors) - new, apart) for column in errors.T]
            size = np.sum(np.where(present, piece.measured, 0.0) ** 2, axis=0)
            step = [np.column_stack([part[0] for part in parts]), np.column_stack([part[1] for part in parts]), size]
            total = step if total is None else [a + b for a, b in zip(total, step, strict=True)]
            tail, tail_segment = errors[-EARLIER * apart :], segment[-EARLIER * apart :]
        if total is None or not np.any(total[1][0]):
            return None
        rows = np.stack([block_sums for block_sums in blocks.values() if np.any(block_sums[1])])
        return cls(
            period, apart, total[0], total[1].astype(np.int64), rows[:, 0], rows[:, 1].astype(np.int64), total[2]
        )

    def join(self, other: Errors) -> Errors:
        """The sums over these errors and over those of ``other`` data."""
        return Errors(
            self.period,
            self.apart,
            self.products + other.products,
            self.pairs + other.pairs,
            np.concatenate([self.squares, other.squares]),
            np.concatenate([self.counts, other.counts]),
            self.size + other.size,
        )

    def mean_square(self, output: int) -> tuple[float, float, int]:
        """Mean squared error of an output, its standard error over blocks, and the number of blocks."""
        used = self.counts[:, output] > 0
        count, squares = self.counts[used, output], self.squares[used, output]
        blocks, whole = len(count), max(1, int(np.sum(count)))
        mean = float(np.sum(squares)) / whole
        scatter = float(np.sum((squares - mean * count) ** 2)) * blocks / max(1, blocks - 1)
        return mean, float(np.sqrt(scatter)) / whole, blocks

    def predictable(self, output: int) -> tuple[float, float]:
        """Share of an output's squared errors that earlier errors predict, and the probability of it by chance.

        The predictor solves the Yule-Walker equations of the lags ``apart``, ``2 apart``, ... The probability is that
        of Fisher's F, as if only every error ``apart`` samples from the next were independent.
        """
        from scipy.linalg import toeplitz
        from scipy.stats import f as fisher

        pairs, products = self.pairs[:, output], self.products[:, output]
        if not np.all(pairs) or products[0] <= 0.0:
            return 0.0, 1.0
        rho = products / pairs / (products[0] / pairs[0])
        # lags lose pairs at the borders: a matrix that is not positive definite gets a little noise
        matrix = toeplitz(rho[:-1])
        lowest = float(np.linalg.eigvalsh(matrix)[0])
        matrix += np.eye(EARLIER) * max(0.0, 1e-6 - lowest)
        share = float(np.clip(rho[1:] @ np.linalg.solve(matrix, rho[1:]), 0.0, 1.0))
        freedom = pairs[0] / self.apart - EARLIER
        if freedom <= 0.0:
            return share, 1.0
        ratio = share / max(1.0 - share, np.finfo(float).eps) * freedom / EARLIER
        return share, float(fisher.sf(ratio, EARLIER, freedom))


def all_errors(parts: Iterable[Errors | None]) -> Errors | None:
    """The sums over all errors ``parts`` together; None without any."""
    there = [part for part in parts if part is not None]
    return reduce(Errors.join, there) if there else None


@dataclass(frozen=True)
class Remainder:
    """What is left in the held-out errors of the output ``name``.

    ``relative_error`` is their norm over that of the measured values. ``growth`` is the ratio of their RMS to that of
    the fitted data, None where there are too few data to compare; ``grown`` whether chance does not explain it.
    ``predictable`` is the share of their squares that earlier errors predict, at least ``seconds`` before, and
    ``follows`` whether chance does not explain that.
    """

    name: str
    relative_error: float
    growth: float | None
    grown: bool
    predictable: float
    follows: bool
    seconds: float

    @property
    def is_left(self) -> bool:
        """Whether noise does not explain the held-out errors."""
        return self.relative_error > NEGLIGIBLE and (self.grown or self.follows)

    @property
    def evidence(self) -> str:
        """What noise does not explain, in words."""
        said = [f"{self.growth:.3g} times that in sample"] if self.grown else []
        if self.follows:
            said.append(f"{100 * self.predictable:.0f} % of its squares follow from errors {self.seconds:.2g} s before")
        return f"{self.name} ({', '.join(said)})"


def remainders(held_out: Errors | None, fitted: Errors | None, names: Sequence[str]) -> tuple[Remainder, ...]:
    """Test the ``held_out`` errors of the outputs ``names`` (n,).

    ``fitted`` are the errors on fitted data, None where they are not known. Empty without held-out errors.
    """
    from scipy.stats import t as student

    leftovers = []
    for k, name in enumerate(names if held_out is not None else ()):
        assert held_out is not None
        mean, error, blocks = held_out.mean_square(k)
        growth, grown = None, False
        if fitted is not None:
            before, fitted_error, others = fitted.mean_square(k)
            fewest, apart = min(blocks, others), float(np.hypot(error, fitted_error))
            if fewest >= FEWEST_BLOCKS and before > 0.0 and apart > 0.0:
                growth = float(np.sqrt(mean / before))
                grown = growth >= GROWN and float(student.sf((mean - before) / apart, fewest - 1)) < UNLIKELY
        share, chance = held_out.predictable(k)
        size = float(held_out.size[k])
        relative = float(np.sqrt(np.sum(held_out.squares[:, k]) / size)) if size > 0.0 else 0.0
        follows = share >= FOLLOWS and chance < UNLIKELY
        leftovers.append(Remainder(name, relative, growth, grown, share, follows, held_out.apart * held_out.period))
    return tuple(leftovers)


CHANGED = "a friction or load that changed, or parameters that the fitted data hardly determine"
UNMODELLED = (
    "friction that its law does not describe, ripple over position, backlash, a flexible joint, or slow noise of the "
    "measurement itself"
)


def remainder_notes(
    leftovers: Sequence[Remainder], errors: str = "torque errors", unmodelled: str = UNMODELLED
) -> tuple[str, ...]:
    """A sentence on the outputs whose held-out ``errors`` noise does not explain, and on what can be left in them.

    ``unmodelled`` names the effects that let errors follow each other. Empty if noise explains all of them.
    """
    left = [remainder for remainder in leftovers if remainder.is_left]
    if not left:
        return ()
    causes = [
        *([CHANGED] if any(remainder.grown for remainder in left) else []),
        *([unmodelled] if any(remainder.follows for remainder in left) else []),
    ]
    return (
        f"noise does not explain the held-out {errors} of {', '.join(remainder.evidence for remainder in left)}: "
        f"something is left, such as {'; or '.join(causes)}",
    )


def remainder_record(leftovers: Sequence[Remainder]) -> list[dict[str, Any]]:
    """Plain data of ``leftovers`` for JSON, one entry for each output."""
    return [vars(remainder) | {"is_left": remainder.is_left} for remainder in leftovers]


def recorded_remainders(record: Sequence[Mapping[str, Any]]) -> tuple[Remainder, ...]:
    """The inverse of :func:`remainder_record`."""
    return tuple(Remainder(**{key: value for key, value in entry.items() if key != "is_left"}) for entry in record)
