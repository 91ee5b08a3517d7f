"""The proof of the error bound of the emitted sine and cosine kernel, by Sollya and Gappa.

The kernel computes n, the number of quarter turns next to x, then ``r = ((x - n h1) - n h2) - n h3`` with
``h1 + h2 + h3`` close to pi/2, and polynomials in r. With R = x - n pi/2 the errors add up:

1. **Quarter turns** (Gappa). n is whole, and ``|n - x c| <= 1/2 + d`` with c the literal of 2/pi; so |R| is at most
   pi/4 plus a little, and |n| has few bits.
2. **Reduction** (integers, below). h1 and h2 have so few bits that n h1 and n h2 are exact. So is x - n h1: both are
   multiples of the last place of x (or x = r where n = 0), and the difference is below 1, or below 2 where |x| >= 1,
   so it has at most as many bits as the format. The other two subtractions and n h3 round; contraction leaves out some.
3. **Polynomials** (Sollya, ``supnorm``): their distance from sine and cosine on |r| <= 0.786.
4. **Evaluation** (Gappa): the roundings of both polynomials, once with all operations rounded, once with every product
   and sum that belong together fused. Contraction of some operations but not of others is covered by the mean-value
   form of :mod:`rrrgen.evidence.rounding`, which shares no code with Gappa.

The last step multiplies by 0, 1 or -1 and adds a zero, which is exact. The range of |r| is cut into pieces [a, b].
On each the error of the sine is at most ``cos(a) |r - R| + 3 + 4``, that of the cosine ``sin(b) |r - R| + 3 + 4``,
with the slopes of sine and cosine taken a little further out, for R.
"""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np

from rrrgen.emit import Real
from rrrgen.emit.c.language import COSINE, ERROR_BOUND, HALF_PI, RANGE, ROUNDING, SINE
from rrrgen.evidence.rounding import rounding_bounds
from rrrgen.program import Builder, Port, Value

TWO_OVER_PI = "0.63661977236758134308"
REACH = Fraction(786, 1000)
"""The range of r on which the polynomials are proven, above pi/4."""

_ENDS = (Fraction(0), Fraction(1, 1000), *(REACH * k / 16 for k in range(1, 17)))
PIECES = tuple(pairwise(_ENDS))
"""The pieces of |r| on which errors are added up; the first is short, since the cosine may be rounded up to 1 there."""

_BITS = {"double": 53, "float": 24}
_FORMAT = {"double": "ieee_64", "float": "ieee_32"}
_PI = Fraction("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")
_PI_ERROR = Fraction(1, 10**79)


class UnprovenError(Exception):
    """A step of the proof failed, or a tool did not answer; the message says which."""


@dataclass(frozen=True)
class KernelProof:
    """Proven absolute errors of (sine, cosine): ``plain`` without contraction, ``fused`` with all of it, ``mixed``.

    ``mixed`` holds for any contraction. ``approximation`` is the part of the polynomials.
    """

    approximation: tuple[float, float]
    plain: tuple[float, float]
    fused: tuple[float, float]
    mixed: tuple[float, float]

    @property
    def worst(self) -> float:
        """The largest of all bounds."""
        return max(*self.plain, *self.fused, *self.mixed)


def tools_missing() -> list[str]:
    """The programs that the proof needs and this machine lacks."""
    return [tool for tool in ("gappa", "sollya") if shutil.which(tool) is None]


def literal(text: str, real: Real) -> Fraction:
    """The exact value of a literal of the kernel in the format ``real``."""
    value = float(text)
    return Fraction(value if real == "double" else float(np.float32(value)))


def scripts(real: Real) -> dict[str, str]:
    """The scripts of the proof, file name -> text: for Gappa (``.g``) and Sollya (``.sollya``)."""
    texts = {"turns.g": _turns_script(real), "polynomials.sollya": _polynomial_script(real)}
    for k, (low, high) in enumerate(PIECES):
        for name, fused in (("plain", False), ("fused", True)):
            texts[f"{name}{k:02}.g"] = _evaluation_script(real, low, high, fused)
    return texts


def prove(real: Real) -> KernelProof:
    """Run the proof for one precision. Raises UnprovenError where a step fails or a sum exceeds the stated bound."""
    if missing := tools_missing():
        raise UnprovenError(f"the proof needs {' and '.join(missing)}")
    texts = scripts(real)
    _gappa(texts["turns.g"])
    approximation = _sollya(texts["polynomials.sollya"])
    check_reduction(real)
    totals: dict[str, list[tuple[float, float]]] = {"plain": [], "fused": [], "mixed": []}
    for k, piece in enumerate(PIECES):
        mixed = mixed_contraction_bound(real, *piece)  # holds for no and for full contraction too
        roundings = {"mixed": mixed}
        for name in ("plain", "fused"):
            by_gappa = _gappa(texts[f"{name}{k:02}.g"])
            roundings[name] = min(by_gappa[0], mixed[0]), min(by_gappa[1], mixed[1])
        for name, rounding in roundings.items():
            totals[name].append(_total(real, piece, approximation, rounding))
    worst = {name: (max(s for s, _ in rows), max(c for _, c in rows)) for name, rows in totals.items()}
    proof = KernelProof(approximation, worst["plain"], worst["fused"], worst["mixed"])
    if proof.worst > ERROR_BOUND[real]:
        raise UnprovenError(f"{real}: {proof.worst:.3g} exceeds {ERROR_BOUND[real]:g}")
    return proof


def _total(
    real: Real, piece: tuple[Fraction, Fraction], approximation: tuple[float, float], rounding: tuple[float, float]
) -> tuple[float, float]:
    """The bounds of sine and cosine on one piece of |r|, from those of the steps."""
    low, high = (float(end) for end in piece)
    moved = reduction_bound(real, piece[1])
    slopes = math.cos(max(low - 1e-6, 0.0)), math.sin(high + 1e-6)
    sine, cosine = (
        (slope * moved + a + e) * (1.0 + 1e-12) for slope, a, e in zip(slopes, approximation, rounding, strict=True)
    )
    return sine, cosine


# ------------------------------------------------------------------------------------------------------------------
# Step 1 and 2: quarter turns and reduction.
# ------------------------------------------------------------------------------------------------------------------


def _slack(real: Real) -> Fraction:
    """How much further than 1/2 the number of turns may be from x c: the rounding of the product."""
    largest = Fraction(RANGE[real]) * literal(TWO_OVER_PI, real)
    return Fraction(2) ** (math.ceil(math.log2(float(largest))) - _BITS[real])


def most_turns(real: Real) -> int:
    """The largest |n| for |x| <= RANGE."""
    return math.floor(Fraction(RANGE[real]) * literal(TWO_OVER_PI, real) + Fraction(1, 2) + _slack(real))


def check_reduction(real: Real) -> None:
    """Raise UnprovenError where a product or the first difference of the reduction is not exact, or |R| too large."""
    bits, turns = _BITS[real], most_turns(real)
    h1, h2, _ = (literal(text, real) for text in HALF_PI[real])
    for part in (h1, h2):
        if part.numerator.bit_length() + turns.bit_length() > bits:
            raise UnprovenError(f"{real}: the product of {turns} and {float(part)} is not exact")
    off = abs(literal(TWO_OVER_PI, real) - 2 / _PI) + Fraction(1, 10**70)
    reach = (Fraction(1, 2) + _slack(real) + Fraction(RANGE[real]) * off) * (_PI + _PI_ERROR) / 2  # of |R|
    if reach + Fraction(reduction_bound(real, REACH)) > REACH:
        raise UnprovenError(f"{real}: |r| may reach {float(reach)}")
    # x - n h1: a multiple of the last place of x, if h1 is one of it; below 1 for |x| < 1 (n = 1), below 2 else
    first = reach + turns * abs(_PI / 2 - h1)
    alone = reach + abs(_PI / 2 - h1)
    finest = Fraction(2) ** (math.ceil(math.log2(float(RANGE[real]))) - bits)  # the last place of the largest x
    if h1 % finest != 0 or first >= 2 or alone >= 1:
        raise UnprovenError(f"{real}: the first difference is not exact")


def reduction_bound(real: Real, high: Fraction) -> float:
    """A bound of |r - R| where |r| <= ``high``: two roundings of numbers near r, that of n h3, and the rest of pi/2."""
    bits, turns = _BITS[real], most_turns(real)
    h1, h2, h3 = (literal(text, real) for text in HALF_PI[real])
    product = turns * abs(h3) * (1 + Fraction(1, 2**bits))
    largest = (high + product) * (1 + Fraction(1, 2 ** (bits - 2)))  # of both differences
    unit = Fraction(2) ** (math.ceil(math.log2(float(largest) * (1.0 + 1e-12))) - bits - 1)  # half a last place
    tail = turns * (abs(_PI / 2 - h1 - h2 - h3) + _PI_ERROR)
    return float(2 * unit + product / 2**bits + tail) * (1.0 + 1e-15)


def _dyadic(value: Fraction) -> str:
    """A number of the format as Gappa reads it: mantissa b exponent."""
    return f"{value.numerator}b-{value.denominator.bit_length() - 1}"


def _turns_script(real: Real) -> str:
    limit = Fraction(1, 2) + _slack(real)
    return f"""# The number of quarter turns is whole and next to x c ({real}).
@rnd = float<{_FORMAT[real]}, ne>;
c = {_dyadic(literal(TWO_OVER_PI, real))};
shift = {_dyadic(literal(ROUNDING[real], real))};
x = rnd(X);
p rnd= x * c;
shifted rnd= p + shift;
n rnd= shifted - shift;
{{ |x| <= {RANGE[real]} -> |n - x * c| <= {_dyadic(limit)} /\\ @FIX(n, 0) }}
n - x * c -> (n - (shifted - shift)) + (shifted - (p + shift)) + (p - x * c);
"""


# ------------------------------------------------------------------------------------------------------------------
# Step 3 and 4: polynomials.
# ------------------------------------------------------------------------------------------------------------------


def _coefficients(real: Real) -> tuple[list[Fraction], list[Fraction]]:
    return [literal(text, real) for text in SINE[real]], [literal(text, real) for text in COSINE[real]]


def _polynomial_script(real: Real) -> str:
    def horner(values: list[Fraction]) -> str:
        text = ""
        for value in reversed(values):
            number = f"({value.numerator}/{value.denominator})"
            text = number if not text else f"({number} + x^2*{text})"
        return text

    sine, cosine = _coefficients(real)
    reach = f"{REACH.numerator}/{REACH.denominator}"
    return f"""// The distance of both polynomials from sine and cosine ({real}).
prec = 200!;
display = decimal!;
s = supnorm(horner(x + x^3*{horner(sine)}), sin(x), [0; {reach}], absolute, 2^-10);
c = supnorm(horner(1 - x^2/2 + x^4*{horner(cosine)}), cos(x), [0; {reach}], absolute, 2^-10);
print(round(sup(s), 24, RU));
print(round(sup(c), 24, RU));
quit;
"""


def _evaluation_script(real: Real, low: Fraction, high: Fraction, fused: bool) -> str:
    lines = [
        f"# Roundings of both polynomials ({real}{', with fused operations' if fused else ''}).",
        f"@rnd = float<{_FORMAT[real]}, ne>;",
        "r = rnd(R);",
        "z rnd= r * r;",
        "Z = r * r;",
    ]
    for letter, values in zip("sc", _coefficients(real), strict=True):
        for k, value in enumerate(values):
            lines.append(f"{letter}{k} = {_dyadic(value)};")
        last = len(values) - 1
        lines += [f"{letter}p{last} = {letter}{last};", f"{letter.upper()}P{last} = {letter}{last};"]
        for k in reversed(range(last)):
            product = f"z * {letter}p{k + 1}"
            lines += _multiply_add_lines(f"{letter}p{k}", f"{letter}{k}", product, f"{letter}m{k}", fused)
            lines.append(f"{letter.upper()}P{k} = {letter}{k} + Z * {letter.upper()}P{k + 1};")
    lines += ["rz rnd= r * z;", *_multiply_add_lines("s", "r", "rz * sp0", "sm", fused), "S = r + r * Z * SP0;"]
    lines += ["half = 0.5 * z;", "one rnd= 1 - half;", "zz rnd= z * z;"]
    lines += [*_multiply_add_lines("c", "one", "zz * cp0", "cm", fused), "C = (1 - 0.5 * Z) + Z * Z * CP0;"]
    lines.append(f"{{ R in [{_decimal(low)}, {_decimal(high)}] -> s - S in ? /\\ c - C in ? }}")
    return "\n".join(lines) + "\n"


def _decimal(value: Fraction) -> str:
    """The exact decimal of a fraction whose denominator divides a power of ten."""
    digits = value * 10**9
    if digits.denominator != 1:
        raise UnprovenError(f"{value} has more than nine decimals")
    return f"{digits.numerator}e-9"


def _multiply_add_lines(name: str, term: str, product: str, temporary: str, fused: bool) -> list[str]:
    if fused:
        return [f"{name} = rnd({term} + {product});"]
    return [f"{temporary} rnd= {product};", f"{name} rnd= {term} + {temporary};"]


def _gappa(script: str) -> tuple[float, float]:
    """Run Gappa; returns the magnitudes of the two enclosures it answers with, (0, 0) for a proof without question."""
    done = subprocess.run(["gappa"], input=script, capture_output=True, text=True, timeout=120, check=False)
    text = done.stdout + done.stderr
    if done.returncode != 0:
        raise UnprovenError(f"gappa: {text.strip()[-400:]}")
    ranges = re.findall(r"in \[(.*)\]$", text, flags=re.M)
    sizes = []
    for line in ranges:
        numbers = [abs(_binary(part)) for part in re.split(r", (?![^{]*\})", line)]
        sizes.append(float(max(numbers)) * (1.0 + 1e-15))
    return (sizes[0], sizes[1]) if len(sizes) == 2 else (0.0, 0.0)


def _binary(text: str) -> Fraction:
    """The number "123b-45 {..}" of Gappa's answer."""
    mantissa, _, exponent = text.split("{")[0].strip().partition("b")
    return Fraction(mantissa) * Fraction(2) ** int(exponent or 0)


def _sollya(script: str) -> tuple[float, float]:
    done = subprocess.run(["sollya"], input=script, capture_output=True, text=True, timeout=120, check=False)
    numbers = re.findall(r"^[0-9.e+-]+$", done.stdout, flags=re.M)
    if len(numbers) != 2:
        raise UnprovenError(f"sollya: {(done.stdout + done.stderr).strip()[-400:]}")
    return float(numbers[0]), float(numbers[1])


def mixed_contraction_bound(real: Real, low: Fraction, high: Fraction) -> tuple[float, float]:
    """Bounds of the roundings of both polynomials on one piece, whatever is contracted: the mean-value form."""
    builder = Builder()
    (r,) = builder.input(Port("r", (1,)))
    z = builder.mul(r, r)
    sine, cosine = _coefficients(real)

    def horner(values: list[Fraction]) -> Value:
        total: Value = values[-1]
        for value in reversed(values[:-1]):
            total = builder.add(value, builder.mul(z, total))
        return total

    s = builder.add(r, builder.mul(builder.mul(r, z), horner(sine)))
    one = builder.sub(1, builder.mul(Fraction(1, 2), z))
    c = builder.add(one, builder.mul(builder.mul(z, z), horner(cosine)))
    program = builder.program("kernel", [(Port("y", (2,)), [s, c])])
    bounds = rounding_bounds(program, {"r": ([float(low)], [math.nextafter(float(high), 1.0)])})
    ((sine_bound, cosine_bound),) = bounds.double if real == "double" else bounds.single
    return sine_bound, cosine_bound
