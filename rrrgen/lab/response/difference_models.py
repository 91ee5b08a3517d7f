"""Difference equations fitted to recordings: ARX (14.41), ARMAX, output error and subspace models.

The order is chosen by the error on rows that are not used for the fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError, option_name, require
from rrrgen.lab.estimate.linear import scale_columns, solve
from rrrgen.lab.estimate.remainder import Errors, Piece, Remainder, remainder_record, remainders
from rrrgen.lab.estimate.search import search
from rrrgen.lab.response.resonances import check_resonances
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import ControllerTransferFunction, ResponseModel, polynomial_sum

# ------------------------------------------------------------------------------------------------------------------
# The difference equation of a linear model, and its least-squares fit (14.41).
# ------------------------------------------------------------------------------------------------------------------

RANK = 1e-13  # past outputs sampled fast are nearly parallel: only what rounding leaves counts as dependent


@dataclass(frozen=True)
class Equation:
    """Difference equation ``y_k = sum a_i y_{k-i} + sum b_j u_{k-delay-j}``, i from 1, j from 0.

    ``a`` and ``b`` hold the coefficients, ``delay`` is in samples.
    """

    a: Array
    b: Array
    delay: int

    @property
    def past(self) -> int:
        """Number of rows before the first one whose output the equation can compute."""
        return max(len(self.a), self.delay + len(self.b) - 1)


def arx(u: Array, y: Array, start: int, stop: int, order: int, delay: int) -> Equation:
    """Fit a difference equation to the rows [start, stop) by least squares ``theta = F# Q``, (14.41).

    It has ``order`` coefficients a and as many coefficients b; without ``delay`` it has one b more. Row k of F is
    ``[y_{k-1} .. y_{k-n}, u_{k-delay} .. ]``; the last one is that of k = stop - 1, so that the columns of (14.42) end
    at t_{zeta-n} (the book's t_{zeta-n+1} is a misprint).
    """
    size = order + 1 if delay == 0 else order
    past = max(order, delay + size - 1)
    k = np.arange(start + past, stop)
    F = np.column_stack([*(y[k - i] for i in range(1, order + 1)), *(u[k - delay - j] for j in range(size))])
    B, lengths = scale_columns(F)
    # filtered signals of a nearly unstable model leave singular values at the tolerance: rounding then decides, and
    # another decomposition of the same columns gives a model with another free run
    theta = np.linalg.lstsq(B, y[k], rcond=RANK)[0] / lengths
    return Equation(theta[:order], theta[order:], delay)


# ------------------------------------------------------------------------------------------------------------------
# ARMAX models ``A y = B u + C e``: difference equations with coloured noise, e being white.
# ------------------------------------------------------------------------------------------------------------------

REFINEMENTS = 20
SMALL_GAIN = 1e-7  # relative decrease of the squared errors at which the refinement ends
LARGEST = 1e100  # bound on the outputs of an unstable model, so that their squares stay finite
LONG_ORDER = 2  # order of the ARX model whose residuals are the first estimate of e, as a multiple of the model's order
OUTERMOST = 0.999  # largest size of a zero of C, of which the filter 1/C must forget its start


def armax(first: Equation, u: Array, y: Array, start: int, stop: int) -> Equation:
    """Fit an ARMAX model ``A y = B u + C e`` that minimizes the one-step prediction errors e on samples [start, stop).

    ``u`` and ``y`` (N,) are input and output, ``first`` gives orders and first estimate; C has the order of A. Begins
    with least squares on estimated e (Hannan and Rissanen 1982) and refines by Levenberg-Marquardt steps: the
    derivatives of e are past outputs, inputs and errors filtered by 1/C. Zeros of C outside the unit circle are
    reflected. The returned equation holds A and B.
    """
    from scipy.signal import lfilter

    order, size, delay = len(first.a), len(first.b), first.delay
    u, y = u[start:stop], y[start:stop]
    columns = _columns(order, size, delay, u, y)

    def divide_by_C(theta: Array, values: Array) -> Array:
        values[: first.past] = 0.0  # rows that need values from before the first row
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(lfilter([1.0], np.concatenate([[1.0], theta[order + size :]]), values, axis=0))

    def errors(theta: Array) -> Array:
        return divide_by_C(theta, y - columns @ theta[: order + size])

    def linearise(theta: Array) -> tuple[Array, Array]:
        e = errors(theta)
        return e, -divide_by_C(theta, np.column_stack([columns, _columns(order, 0, 0, e, e)]))

    def move(theta: Array, step: Array) -> Array:
        after = theta + step
        return np.concatenate([after[: order + size], _reflect(after[order + size :])])

    theta = search(
        _first_estimate(first, columns, u, y),
        linearise,
        moved=move,
        cost=lambda theta: float(np.sum(errors(theta) ** 2)),
        trials=REFINEMENTS,
        small_gain=SMALL_GAIN,
        less=5.0,
    ).state
    return Equation(theta[:order], theta[order : order + size], delay)


def _columns(order: int, size: int, delay: int, u: Array, y: Array) -> Array:
    """The matrix (N, order + size) of past outputs and inputs, with zeros for times before the first row."""
    shifts = [(y, i) for i in range(1, order + 1)] + [(u, delay + j) for j in range(size)]
    columns = np.zeros((len(y), len(shifts)))
    for column, (signal, shift) in zip(columns.T, shifts, strict=True):
        column[shift:] = signal[: len(y) - shift]
    return columns


def _first_estimate(first: Equation, columns: Array, u: Array, y: Array) -> Array:
    """Coefficients [a, b, c] by least squares on the errors e of an ARX model of high order."""
    order, delay = len(first.a), first.delay
    many = LONG_ORDER * order + 1
    F = _columns(many, many, delay, u, y)
    if len(y) <= 3 * F.shape[1]:
        return np.concatenate([first.a, first.b, np.zeros(order)])
    e = solve(F, y, RANK).residual(y)
    G = np.column_stack([columns, _columns(order, 0, 0, e, e)])
    theta = solve(G[many:], y[many:], RANK).x
    return np.concatenate([theta[:-order], _reflect(theta[-order:])])


def _reflect(c: Array) -> Array:
    """Reflect the zeros of ``1 + sum c_l z^-l`` that lie outside the unit circle into it; returns the new ``c``."""
    roots = np.roots(np.concatenate([[1.0], c]))
    sizes = np.abs(roots)
    outside = sizes > OUTERMOST
    if not np.any(outside):
        return c
    inner = np.minimum(1.0 / np.maximum(sizes, 1.0), OUTERMOST)
    reflected = np.where(outside, roots / np.maximum(sizes, 1e-12) * inner, roots)
    coefficients = np.real(np.poly(reflected))[1:]
    return np.concatenate([coefficients, np.zeros(len(c) - len(coefficients))])


# ------------------------------------------------------------------------------------------------------------------
# Subspace identification by the package nfoursid (extra ``response``): no search, no local minima.
# ------------------------------------------------------------------------------------------------------------------

MOST_BLOCK_ROWS = 30
ROWS_PER_BLOCK_ROW = 12  # samples
MOST_ROWS = 3000  # the library's memory grows with their square


def check_rows(rows: int) -> None:
    """Raise :class:`DerivationError` if there are more rows than the memory of the library's method allows."""
    if rows > MOST_ROWS:
        raise DerivationError(
            f"{rows} rows are too many for subspace identification, whose library needs memory that grows with their "
            f"square: choose up to {MOST_ROWS} with {option_name('fit_rows')}"
        )


class SubspaceIdentification:
    """N4SID/PO-MOESP models of the rows [start, stop) of an input ``u`` and an output ``y`` (N,), order by order.

    Raises :class:`MissingExtraError` without nfoursid, :class:`DerivationError` for too few rows.
    """

    def __init__(self, u: Array, y: Array, start: int, stop: int) -> None:
        require(f"{option_name('method')} subspace", "nfoursid", "pandas")
        from nfoursid.nfoursid import NFourSID
        from pandas import DataFrame

        self.rows = min(MOST_BLOCK_ROWS, (stop - start) // ROWS_PER_BLOCK_ROW)
        if self.rows < 2:
            raise DerivationError(f"{stop - start} rows are too few for subspace identification")
        # both scaled to size 1, because tolerances of the library's pseudo-inverses are relative
        self.scale_u, self.scale_y = (max(float(np.std(x[start:stop])), 1e-300) for x in (u, y))
        frame = DataFrame({"u": u[start:stop] / self.scale_u, "y": y[start:stop] / self.scale_y})
        self._found: Any = NFourSID(frame, ["y"], ["u"], num_block_rows=self.rows)
        self._found.subspace_identification()

    @property
    def highest_order(self) -> int:
        """The highest order that the number of block rows allows."""
        return self.rows - 1

    def model(self, order: int) -> Equation:
        """The model of the given ``order`` as a difference equation without delay."""
        system, _ = self._found.system_identification(rank=order)
        A, B, C, D = (np.asarray(getattr(system, name)) for name in "abcd")
        denominator = np.poly(A).real
        numerator = np.poly(A - B @ C).real + (float(D[0, 0]) - 1.0) * denominator
        b = numerator * self.scale_y / self.scale_u
        return Equation(-denominator[1:], b, 0)


# ------------------------------------------------------------------------------------------------------------------
# Difference equations fitted to recordings
# ------------------------------------------------------------------------------------------------------------------

HIGHEST_ORDER = 20
VALIDATION = 0.25  # share of the rows, the last ones, on which the order is chosen
NEARLY_BEST = 1.2  # the lowest order whose validation error is below this multiple of the smallest one is chosen
LEAST_FIT = 0.1  # share of the validation rows that the best model must explain
PREFILTERS = 10
SHORT_RUN = 50  # length of a short free run, samples


def fit_difference_model(
    record: ResponseRecording,
    rows: tuple[int, int] | None = None,
    method: str = "auto",
    controller: ControllerTransferFunction | None = None,
) -> ResponseModel:
    """Fit a model to the ``rows`` (first, last, counted from 1; all but the last third by default) of a recording.

    ``method`` is "arx", "armax" or "output_error"; "auto", the best of them on the validation rows; "subspace" (extra
    ``response``); or "indirect": an ARX model from n to q, from which the plant follows with the controller. Orders are
    chosen within the fitted rows; the other rows test the model. Raises :class:`DerivationError` for too few rows.
    """
    u = record.n if method == "indirect" else record.u
    if method == "indirect" and controller is None:
        raise InputError("the indirect method needs the controller: name it in the response file")
    for name, column in (("input", u), ("output", record.q)):
        if not float(np.ptp(column)) > 0.0:
            raise DerivationError(f"{record.name}: the column of the {name} is constant, so there is no response")
    y, (first, last) = record.q, rows or (1, 2 * len(u) // 3)
    if not 1 <= first < last <= len(y):
        raise InputError(f"rows {first}:{last} of a recording with rows 1:{len(y)}")
    start, stop = first - 1, last
    if method == "subspace":
        check_rows(stop - start)
    cut = stop - int(VALIDATION * (stop - start))
    open_loop, plant = np.array_equal(record.u, record.n), record.u
    if not open_loop:
        u, y, plant = (_remove_ramp(column, start, stop) for column in (u, y, plant))
    short = not open_loop and method != "indirect"  # the plant may integrate, so that long free runs drift
    candidates, table = [], []
    for equation, kind in _candidates(u, y, start, cut, method, 0 if open_loop and method != "indirect" else 1):
        if short:
            error = _short_run_error(equation, u, y, cut, stop)
        else:
            error = _relative(y[cut:stop] - continued_run(equation, u, y, start, cut, stop), y[cut:stop])
        row = {"method": kind, "order": len(equation.a), "delay": equation.delay, "validation_fit": 100.0 * (1 - error)}
        grows = open_loop and _oscillation_grows(equation)
        candidates.append((grows, error, len(equation.a), kind, equation.delay))
        table.append(row)
    finite_candidates = [candidate for candidate in candidates if np.isfinite(candidate[1])]
    finite = [candidate[1:] for candidate in finite_candidates if not candidate[0]] or [
        candidate[1:] for candidate in finite_candidates
    ]
    if not finite:
        raise DerivationError(
            f"{record.name}: {cut - start} rows are too few for an order of 1 and its validation, or no model is stable"
        )
    best = min(finite)[0]
    if best > 1.0 - LEAST_FIT:
        kinds, hint = ("", "") if method == "auto" else (f"{method} ", f" Or choose {option_name('method')} auto.")
        raise DerivationError(
            f"{record.name}: fitted to the rows {start + 1}:{cut}, no {kinds}model predicts the rows {cut + 1}:{stop} "
            "better than their mean: are the columns right, and do the rows to fit "
            f"({option_name('fit_rows')}) excite every mode several times, not in a single sweep?{hint}"
        )
    limit = NEARLY_BEST * best
    _, order, kind, delay = min((contender[1], contender) for contender in finite if contender[0] <= limit)[1]
    equation = _fit(kind, u, y, start, stop, order, delay)
    fit = _scores(equation, u, y, start, stop)
    if fit["held_out"]:
        left = left_after(equation, u, y, start, stop, record.period, as_sensor=kind == "output_error" and not short)
        fit["held_out_remainder"] = remainder_record(left)
    if short:
        begin, end = fit["scored_rows"]
        fit["free_run"] = fit["value"]
        fit["value"] = 100.0 * (1.0 - _short_run_error(equation, u, y, begin - 1, end))
        fit["protocol"] = f"free runs of {SHORT_RUN} samples each, from the measured past: measured inputs"
    a, b, delay = equation.a, equation.b, equation.delay
    if method == "indirect" and controller is not None:
        a, b = plant_of_loop(a, b, delay, controller)
        fit["of"] = "the closed loop from n to q"
        if fit["held_out"]:
            fit["value"] = fit["free_run_with_state_from_fitted_rows"]
            fit["protocol"] = "free run with the state that the fitted rows lead to: measured excitation"
    return ResponseModel(
        method=f"indirect {kind}" if method == "indirect" else kind,
        a=a,
        b=b,
        delay=delay,
        period=record.period,
        resonances=check_resonances(a, delay, plant[start:stop], y[start:stop], record.period),
        fit=fit,
        table=tuple(table),
        name=record.name,
    )


def _candidates(
    u: Array, y: Array, start: int, stop: int, method: str, least_delay: int
) -> Iterator[tuple[Equation, str]]:
    """Yield fitted models of increasing order as pairs (equation, name of the kind of model, such as "arx").

    They are fitted to the rows [start, stop). ``least_delay`` 0 lets the output follow the input at once; with 1,
    delays of one and two samples are tried.
    """
    kinds = {"auto": ("arx", "armax", "output_error"), "indirect": ("arx", "output_error")}.get(method, (method,))
    subspace = SubspaceIdentification(u, y, start, stop) if method == "subspace" else None
    for order in range(1, HIGHEST_ORDER + 1):
        if subspace is not None:
            if order > subspace.highest_order:
                return
            yield subspace.model(order), "subspace"
            continue
        for delay in (least_delay,) if least_delay == 0 else (1, 2):
            if stop - start - order < 3 * (2 * order + 1):
                return
            for kind in kinds:
                yield _fit(kind, u, y, start, stop, order, delay), kind


def _oscillation_grows(equation: Equation) -> bool:
    """Whether a pair of complex poles is unstable, which no arm in open loop has."""
    poles = np.roots(np.concatenate([[1.0], -equation.a]))
    return bool(np.any((np.abs(poles) > 1.0) & (np.abs(poles.imag) > 0.0)))


def _fit(kind: str, u: Array, y: Array, start: int, stop: int, order: int, delay: int) -> Equation:
    if kind == "subspace":
        return SubspaceIdentification(u, y, start, stop).model(order)
    equation = arx(u, y, start, stop, order, delay)
    if kind == "armax":
        return armax(equation, u, y, start, stop)
    return output_error(equation, u, y, start, stop) if kind == "output_error" else equation


def free_run(equation: Equation, u: Array, y: Array, start: int, stop: int) -> Array:
    """Simulate the model in the rows [start, stop), from the measured inputs and the outputs measured before start."""
    from scipy.signal import lfilter, lfiltic

    denominator = np.concatenate([[1.0], -equation.a])
    numerator = np.concatenate([np.zeros(equation.delay), equation.b])
    past = y[max(0, start - len(equation.a)) : start][::-1]
    before = u[max(0, start - len(numerator)) : start][::-1]
    output, _ = lfilter(numerator, denominator, u[start:stop], zi=lfiltic(numerator, denominator, past, before))
    return np.asarray(output)


def _prefilter(equation: Equation, u: Array, y: Array, start: int, stop: int) -> Equation:
    """Improve the initial equation of an output-error fit by repeated ARX fits to filtered signals.

    The filter is 1/A of the fit before (Steiglitz and McBride). ARX is biased by measurement noise; the filter turns
    its equation error into an output error.
    """
    from scipy.signal import lfilter

    best, iterate = equation, equation
    least = _least_error(equation, u[start:stop], y[start:stop])
    for _ in range(PREFILTERS):
        denominator = np.concatenate([[1.0], -iterate.a])
        if np.max(np.abs(np.roots(denominator))) > 1.0:
            break
        filtered = [lfilter([1.0], denominator, column[start:stop]) for column in (u, y)]
        iterate = arx(filtered[0], filtered[1], 0, stop - start, len(equation.a), equation.delay)
        error = _least_error(iterate, u[start:stop], y[start:stop])
        if error < least:
            best, least = iterate, error
    return best


def output_error(equation: Equation, u: Array, y: Array, start: int, stop: int) -> Equation:
    """Refine ``equation`` to the smallest free-run error over the rows [start, stop), by Levenberg-Marquardt steps.

    They begin at ``equation`` or at its prefiltered form (:func:`_prefilter`), whichever has the smaller error. The
    derivatives of the free run by a_i and b_j are the past outputs and inputs filtered by 1/A.
    """
    equation = _prefilter(equation, u, y, start, stop)
    order, size, delay = len(equation.a), len(equation.b), equation.delay
    part, measured = u[start:stop], y[start:stop]
    theta, damping = np.concatenate([equation.a, equation.b, _initial_state(equation, part, measured)]), 1e-3
    with np.errstate(over="ignore", invalid="ignore"):
        model = _run(theta, order, delay, size, part)
        cost = float(np.sum((measured - model) ** 2))
        for _ in range(REFINEMENTS):
            J = _free_run_derivatives(theta, order, delay, size, part, model)
            if not float(np.abs(J).max()) < LARGEST:
                break
            information = J.T @ J
            D = np.diag(np.diag(information))
            # its least-norm step bounds what the damping does not: `search` ends at models of other orders here
            step = np.linalg.lstsq(information + damping * D, J.T @ (measured - model), rcond=None)[0]
            run = _run(theta + step, order, delay, size, part)
            new = float(np.sum((measured - run) ** 2))
            if np.isfinite(new) and new < cost:
                done = cost - new < SMALL_GAIN * cost
                theta, model, cost, damping = theta + step, run, new, damping / 5.0
                if done:
                    break
            else:
                damping *= 10.0
    return Equation(theta[:order], theta[order : order + size], delay)


def _run(theta: Array, order: int, delay: int, size: int, u: Array) -> Array:
    """Simulate the model ``theta = [a, b, initial state]``; the state is that of a filter in transposed direct form."""
    from scipy.signal import lfilter

    state = theta[order + size :]
    numerator = np.concatenate([np.zeros(delay), theta[order : order + size]])
    return np.asarray(lfilter(numerator, np.concatenate([[1.0], -theta[:order]]), u, zi=state)[0])


def _free_run_derivatives(theta: Array, order: int, delay: int, size: int, u: Array, model: Array) -> Array:
    """Derivatives of the free run (one column per entry of theta): past outputs, inputs and unit pulses through 1/A."""
    from scipy.signal import lfilter

    pulse = np.zeros(len(u))
    pulse[0] = 1.0
    shifted = [(model, i) for i in range(1, order + 1)] + [(u, delay + j) for j in range(size)]
    shifted += [(pulse, i) for i in range(len(theta) - order - size)]
    columns = np.zeros((len(u), len(shifted)))
    for column, (signal, shift) in zip(columns.T, shifted, strict=True):
        column[shift:] = signal[: len(u) - shift]
    return np.asarray(lfilter([1.0], np.concatenate([[1.0], -theta[:order]]), columns, axis=0))


def _initial_state(equation: Equation, u: Array, y: Array) -> Array:
    """Find, by least squares, the state at the first row whose free run is nearest to the measured outputs."""
    order, size, delay = len(equation.a), len(equation.b), equation.delay
    states = max(order, delay + size - 1)
    theta = np.concatenate([equation.a, equation.b, np.zeros(states)])
    with np.errstate(over="ignore", invalid="ignore"):
        rest = y - _run(theta, order, delay, size, u)
        J = _free_run_derivatives(theta, order, delay, size, u, u)[:, order + size :]
        if not (float(np.abs(J).max(initial=0.0)) < LARGEST and float(np.abs(rest).max(initial=0.0)) < LARGEST):
            return np.zeros(states)
        return np.asarray(np.linalg.lstsq(J, rest, rcond=None)[0])


def continued_run(equation: Equation, u: Array, y: Array, start: int, begin: int, end: int) -> Array:
    """The free run in the rows [begin, end), with the initial state estimated from the rows [start, begin) before."""
    state = _initial_state(equation, u[start:begin], y[start:begin])
    theta = np.concatenate([equation.a, equation.b, state])
    with np.errstate(over="ignore", invalid="ignore"):
        return _run(theta, len(equation.a), equation.delay, len(equation.b), u[start:end])[begin - start :]


def plant_of_loop(a: Array, b: Array, delay: int, controller: ControllerTransferFunction) -> tuple[Array, Array]:
    """The plant P of a loop whose response T from n to q is ``T = B/A = P/(1 + C P)``, with the controller C = N/D.

    ``a``, ``b`` and ``delay`` are the coefficients of T. Returns those of ``P = T/(1 - C T) = B D/(A D - N B)``, which
    has the same delay.
    """
    N, D = np.array(controller.numerator), np.array(controller.denominator)
    A, B = np.concatenate([[1.0], -a]), np.concatenate([np.zeros(delay), b])
    denominator = polynomial_sum(np.convolve(A, D), -np.convolve(N, B))
    return -denominator[1:] / denominator[0], np.convolve(b, D) / denominator[0]


def _remove_ramp(column: Array, start: int, stop: int) -> Array:
    """Subtract from ``column`` the straight line fitted to its rows [start, stop).

    The line is the motion at constant speed of (14.36).
    """
    t = np.arange(len(column), dtype=float)
    return np.asarray(column - np.polyval(np.polyfit(t[start:stop], column[start:stop], 1), t))


def _short_run_error(equation: Equation, u: Array, y: Array, begin: int, end: int) -> float:
    """Relative error of free runs of :data:`SHORT_RUN` samples each, one after the other in the rows [begin, end)."""
    starts = range(max(begin, equation.past), end - SHORT_RUN + 1, SHORT_RUN)
    if not len(starts):
        return np.inf
    parts = [y[k : k + SHORT_RUN] - free_run(equation, u, y, k, k + SHORT_RUN) for k in starts]
    return _relative(np.concatenate(parts), y[starts[0] : starts[-1] + SHORT_RUN])


def left_after(
    equation: Equation, u: Array, y: Array, start: int, stop: int, period: float, *, as_sensor: bool
) -> tuple[Remainder, ...]:
    """Test whether the errors on the rows from ``stop`` on hold more than noise; the rows [start, stop) were fitted.

    ``period`` (s) lies between rows. Noise of a sensor (``as_sensor``) is added to the output, so that the errors of a
    free run show it unchanged; they are tested. Noise that passes through the equation would ring on in a free run:
    there the errors of the one-step prediction are tested, relative to the change of y from sample to sample.
    """
    first, end = start + max(equation.past, 1), len(y)

    def errors_of(model: Array, size: Array, begin: int) -> Errors | None:
        rows = np.arange(begin, begin + len(model))
        pieces = [Piece(period * rows, size[:, None], (y[rows] - model)[:, None], np.zeros(len(rows), np.int64))]
        return Errors.of(pieces, 0 if as_sensor else equation.past)

    if as_sensor:
        held = errors_of(continued_run(equation, u, y, start, stop, end), y[stop:], stop)
        fitted = errors_of(free_run(equation, u, y, first, stop), y[first:stop], first)
        return remainders(held, fitted, ("the free run",))
    held = errors_of(_one_step(equation, u, y, stop, end), np.diff(y[stop - 1 :]), stop)
    fitted = errors_of(_one_step(equation, u, y, first, stop), np.diff(y[first - 1 : stop]), first)
    return remainders(held, fitted, ("the one-step prediction",))


def _one_step(equation: Equation, u: Array, y: Array, begin: int, end: int) -> Array:
    """Predictions of the outputs of the rows [begin, end) from the measured values before each."""
    k = np.arange(begin, end)
    step = sum(c * y[k - i] for i, c in enumerate(equation.a, start=1))
    return np.asarray(step + sum(c * u[k - equation.delay - j] for j, c in enumerate(equation.b)))


def _relative(error: Array, y: Array) -> float:
    size = float(np.linalg.norm(y - y.mean()))
    with np.errstate(over="ignore", invalid="ignore"):
        ratio = float(np.linalg.norm(error)) / size if size > 0.0 else np.inf
    return ratio if np.isfinite(ratio) else np.inf


def _least_error(equation: Equation, u: Array, y: Array) -> float:
    """Error of the free run that begins with the state that fits best at the first row."""
    theta = np.concatenate([equation.a, equation.b, _initial_state(equation, u, y)])
    with np.errstate(over="ignore", invalid="ignore"):
        return _relative(y - _run(theta, len(equation.a), equation.delay, len(equation.b), u), y)


def _free_run_error(equation: Equation, u: Array, y: Array, start: int, stop: int) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        return _relative(y[start:stop] - free_run(equation, u, y, start, stop), y[start:stop])


def _scores(equation: Equation, u: Array, y: Array, start: int, stop: int) -> dict[str, Any]:
    """Scores 100 (1 - |y - y_model|/|y - mean y|) of a model, by name of the simulation that gives y_model.

    It is a free run or the one-step prediction. The rows after the fitted ones are scored or, if these are too few, the
    fitted rows themselves.
    """
    after = len(y) - stop >= 10 * max(len(equation.a), 1)
    begin, end = (stop, len(y)) if after else (start + equation.past, stop)
    step = _one_step(equation, u, y, begin, end)
    quiet = free_run(equation, u, np.zeros_like(y), 0, end)[begin:]
    continued = continued_run(equation, u, y, start, begin, end) if after else free_run(equation, u, y, begin, end)
    part = y[begin:end]
    return {
        "value": 100.0 * (1.0 - _free_run_error(equation, u, y, begin, end)),
        "unit": "100 (1 - |y - y_model|/|y - mean y|)",
        "protocol": "free run from the measured past: measured inputs, outputs measured before the first scored row",
        "fitted_rows": [start + 1, stop],
        "scored_rows": [begin + 1, end],
        "held_out": after,
        "one_step": 100.0 * (1.0 - _relative(part - step, part)),
        "free_run_from_zero_state": 100.0 * (1.0 - _relative(part - quiet, part)),
        "free_run_with_state_from_fitted_rows": 100.0 * (1.0 - _relative(part - continued, part)),
    }
