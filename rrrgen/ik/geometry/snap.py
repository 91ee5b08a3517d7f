"""Snaps nearly special geometry to the special case, in floats and, with the same zeros, in exact numbers."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from rrrgen.ik.geometry.chain import Chain, Link, Number


def snapped(chain: Chain, tolerance: float) -> Chain:
    """``chain`` with lengths, sines and cosines nearer to zero than ``tolerance`` (times the reach) set to zero."""
    least = tolerance * chain.reach
    return replace(chain, links=tuple(_snap(link, least, tolerance) for link in chain.links))


def _snap(link: Link, least: float, tolerance: float) -> Link:
    ca, sa = _direction(float(link.ca), float(link.sa), tolerance)
    ct, st = _direction(float(link.ct), float(link.st), tolerance)
    d, a = (0.0 if abs(float(x)) < least else float(x) for x in (link.d, link.a))
    return Link(d, a, ca, sa, ct, st)


def _direction(c: float, s: float, tolerance: float) -> tuple[float, float]:
    if abs(s) < tolerance:
        return (1.0 if c > 0 else -1.0), 0.0
    if abs(c) < tolerance:
        return 0.0, (1.0 if s > 0 else -1.0)
    return c, s


def exact_like(exact: Chain, decided: Chain) -> Chain:
    """``exact`` with 0 and +-1 wherever the numeric chain ``decided`` has them: the closed form that was chosen."""

    def number(x: Number, value: float) -> Number:
        return sp.Integer(int(value)) if value in (0.0, 1.0, -1.0) else x

    fields = ("d", "a", "ca", "sa", "ct", "st")
    links = tuple(
        Link(*(number(getattr(link, f), float(getattr(like, f))) for f in fields))
        for link, like in zip(exact.links, decided.links, strict=True)
    )
    return replace(exact, links=links)
