"""C code for all real roots of a real trigonometric polynomial of fixed degree (template ``c/ik/trig_roots.c.j2``).

On an arc of a quarter turn, u = tan((x - centre)/2) lies in [-t, t] with t = tan(pi/8), and for a polynomial p of
degree N, p(x) (1 + u^2)^N is a polynomial of degree 2 N in u. Its Bernstein coefficients on [-t, t] bound it, and
their sign changes bound its number of roots from above with the right parity.
"""

from __future__ import annotations

from fractions import Fraction
from math import comb

from rrrgen.resources import render as render_template

WORDS = {"REAL": "double", "SQRT": "sqrt", "FABS": "fabs", "ATAN2": "atan2"}
"""Shorthands of the templates and what they mean in double precision; single precision appends an f."""

_EPS = {"double": 2.220446049250313e-16, "float": 1.1920929e-07}
_DONE = {
    "double": 1.5e-10,
    "float": 3e-6,
}  # roots are simple or flagged: the error after such a Newton step is its square
_NARROWEST = {8: 2.0**-14}  # of an arc: where the elimination for six joints magnifies, it need not be split further


def trig_roots(prefix: str, degree: int, real: str = "double", *, shorthand: bool = False) -> str:
    """The text of ``static int PREFIX_trig_roots_DEGREE(a, b, noise, root, mult)`` and its tables.

    p(x) = a[0] + sum_k a[k] cos(k x) + b[k] sin(k x), k = 1 .. degree in {1, 2, 4, 8}. ``real`` is ``"double"`` or
    ``"float"``; with ``shorthand`` the text keeps the words :data:`WORDS` for the caller to replace.
    """
    even, odd = bernstein_tables(degree)
    text = render_template(
        "c/ik/trig_roots.c.j2",
        p=prefix,
        N=degree,
        even=[literals(row) for row in even],
        odd=[literals(row) for row in odd],
        width=_NARROWEST.get(degree, 2.0**-22),
        eps=_EPS[real],
        done=_DONE[real],
    )
    return text if shorthand else spelled(text, real)


def literals(values: list[float] | tuple[float, ...]) -> str:
    """Numbers as C constants of the file's real type, separated by commas."""
    return ", ".join(f"(REAL){float(v) + 0.0!r}" for v in values)


def spelled(text: str, real: str) -> str:
    """``text`` with the shorthands of the templates replaced by C of that precision."""
    import re

    suffix = "f" if real == "float" else ""
    words = {key: real if key == "REAL" else value + suffix for key, value in WORDS.items()}
    return re.sub(r"\b(" + "|".join(words) + r")\b", lambda match: words[match[1]], text)


def bernstein_tables(degree: int) -> tuple[list[list[float]], list[list[float]]]:
    """Bernstein coefficients 0 .. degree (of 2 degree; the rest by symmetry) of cos(k x) and sin(k x), weighted.

    cos(k x) + i sin(k x), times (1 + u^2)^N, is (1 + i u)^(N + k) (1 - i u)^(N - k): integer coefficients of u^m. On
    [-t, t] the Bernstein coefficient j of u^m is t^m e(m, j) / C(2 N, m) with e(m, j) the coefficient of z^m in
    (1 + z)^j (1 - z)^(2 N - j). All exact up to t = sqrt(2) - 1, rounded once.
    """
    n = 2 * degree
    symmetric = [_product(j, n - j) for j in range(degree + 1)]
    powers = [_pell(m) for m in range(n + 1)]
    even, odd = [], []
    for k in range(degree + 1):
        real, imaginary = _circle(degree + k, degree - k)
        even.append([_sum(real, symmetric[j], powers, n) for j in range(degree + 1)])
        if k > 0:
            odd.append([_sum(imaginary, symmetric[j], powers, n) for j in range(degree + 1)])
    return even, odd


def _product(plus: int, minus: int) -> list[int]:
    """Coefficients of (1 + z)^plus (1 - z)^minus."""
    c = [1]
    for sign in [1] * plus + [-1] * minus:
        c = [x + sign * y for x, y in zip([*c, 0], [0, *c], strict=True)]
    return c


def _circle(plus: int, minus: int) -> tuple[list[int], list[int]]:
    """Real and imaginary coefficients of (1 + i u)^plus (1 - i u)^minus."""
    units = [(1, 0), (0, 1), (-1, 0), (0, -1)]
    c = _product(plus, minus)
    return [x * units[m % 4][0] for m, x in enumerate(c)], [x * units[m % 4][1] for m, x in enumerate(c)]


def _pell(m: int) -> tuple[int, int]:
    """(x, y) with (sqrt(2) - 1)^m = x + y sqrt(2)."""
    x, y = 1, 0
    for _ in range(m):
        x, y = 2 * y - x, x - y
    return x, y


def _sum(c: list[int], e: list[int], powers: list[tuple[int, int]], n: int) -> float:
    """sum_m c[m] e[m] t^m / C(n, m), rounded once: x + y sqrt(2) with rational x, y and sixty digits of the root."""
    x = sum((Fraction(c[m] * e[m] * powers[m][0], comb(n, m)) for m in range(n + 1)), Fraction())
    y = sum((Fraction(c[m] * e[m] * powers[m][1], comb(n, m)) for m in range(n + 1)), Fraction())
    return float(x + y * _ROOT2)


def _root2() -> Fraction:
    from math import isqrt

    return Fraction(isqrt(2 * 10**120), 10**60)


_ROOT2 = _root2()
