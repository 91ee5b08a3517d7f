"""Rules for the names of robots, joints, motors and parameters."""

from __future__ import annotations

import keyword
import re

MAX_NAME = 40  # the prefix leaves room for the longest function name within C99's 63 significant characters


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_C_KEYWORDS = _words("""auto break case char const
continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
alignas alignof bool complex constexpr false imaginary noreturn nullptr thread_local true typeof""")

_CPP_KEYWORDS = _words("""and and_eq asm atomic_cancel atomic_commit atomic_noexcept bitand bitor catch char8_t char16_t
char32_t class co_await co_return co_yield compl concept consteval constinit const_cast decltype delete dynamic_cast
explicit export final friend import module mutable namespace new noexcept not not_eq operator or or_eq override private
protected public reflexpr reinterpret_cast requires static_assert static_cast template this throw try typeid typename
using virtual wchar_t xor xor_eq""")

# a robot's name is also the name of its header and of its Python module; here are those that exist already
_HEADERS = _words("""assert complex ctype errno
fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype unistd
windows""")
_MODULES = _words("std casadi numpy sympy scipy rrrgen test main")

_DEVICES = _words("con prn aux nul conin conout clock") | {f"{port}{k}" for port in ("com", "lpt") for k in range(10)}
"""Names that Windows keeps for devices, with any suffix: there is no file con.h."""

_C_LIBRARY = _words("""abs acos acosh asin
asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs
fdim floor fma fmax fmin fmod frexp hypot isfinite isinf isnan isnormal ldexp lgamma log log10
log1p log2 logb lrint lround modf nan nearbyint nextafter pow remainder remquo rint round scalbln scalbn signbit sin
sinh sqrt tan tanh tgamma trunc NAN INFINITY M_PI NULL errno malloc free calloc realloc memcpy memset memmove printf
puts rand srand real_t double_t float_t casadi_real casadi_int casadi_sq casadi_fmin casadi_fmax""")

_STATE = _words("q dq ddq tau beta phi pi E I")
_NUMBERED = re.compile(r"(d{0,2}q|tau|m|mx|my|mz|x|y|z|I[xyz]{2}|Ia|fv|fc)\d+")
_BASE_PARAMETER = re.compile(r"(m|h[xyz]|[IJ][xyz]{2})\d+R")
_ADDED_COLUMN = re.compile(r"off\d+")

KEYWORDS = _C_KEYWORDS | _CPP_KEYWORDS
ROBOT_RESERVED = _HEADERS | _MODULES | _C_LIBRARY
PARAMETER_RESERVED = _C_LIBRARY | _STATE

IDENTIFIER = rf"^[A-Za-z][A-Za-z0-9_]{{0,{MAX_NAME - 1}}}$"


def name_fault(name: str, role: str) -> tuple[str, str] | None:
    """Message and hint if ``name`` is not allowed; None if it is.

    ``role`` is "robot", "joint", "motor", "parameter" or "base parameter".
    """
    shown = name if len(name) <= MAX_NAME else name[:MAX_NAME] + "..."
    if len(name) > MAX_NAME:
        return f"the {role} name '{shown}' is too long", f"at most {MAX_NAME} characters"
    if re.fullmatch(IDENTIFIER, name) is None:
        better = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        hint = "letters, digits and _, beginning with a letter"
        if re.fullmatch(IDENTIFIER, better):
            hint += f", e.g. {better}"
        return f"the {role} name '{shown}' is not an identifier", hint
    if name in KEYWORDS:
        return f"the {role} name '{name}' is a keyword of C or C++", f"e.g. {name}_1"
    if keyword.iskeyword(name):
        return f"the {role} name '{name}' is a keyword of Python", f"e.g. {name}_1"
    if name.startswith("casadi"):
        return f"the {role} name '{name}' is reserved by CasADi", f"e.g. my_{name}"
    if role == "robot" and name.lower() in _DEVICES:
        return f"the robot name '{name}' is a device of Windows, where no file can be called so", f"e.g. {name}_robot"
    if role == "robot" and (name in ROBOT_RESERVED or name.lower() in _HEADERS):  # file names without case: Math.h
        return f"the robot name '{name}' is taken by a C header or library function", f"e.g. {name}_robot"
    if role == "base parameter" and (name in _STATE or _NUMBERED.fullmatch(name) or _ADDED_COLUMN.fullmatch(name)):
        hint = f"a name of its own, e.g. {name}R or p1; link symbols, drive terms and variables are taken"
        return f"the base parameter name '{name}' is that of a standard parameter or variable", hint
    if role == "parameter" and _BASE_PARAMETER.fullmatch(name):
        return f"the parameter name '{name}' is reserved", "m1R, hx1R, Jxx1R, Izz1R and the like are base parameters"
    if role == "parameter" and (name in PARAMETER_RESERVED or _NUMBERED.fullmatch(name)):
        hint = "q1, dq1, m1, x1, Ixx1 and the like are joint variables and link symbols; C functions are reserved too"
        return f"the parameter name '{name}' is reserved", hint
    return None


def identifier(text: str) -> str:
    """Turn ``text`` into a C identifier: other characters are replaced; empty if it has no usable character."""
    word = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")[:MAX_NAME]
    return f"_{word}" if word[:1].isdigit() else word
