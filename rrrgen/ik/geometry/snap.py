"""Replacement of nearly special geometry by the special one: small lengths, sines and cosines become exactly zero."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp

from rrrgen.ik.geometry.chain import Chain, Link, Number


def snapped(chain: Chain, tolerance: float) -> Chain:
    """Set the lengths below ``tolerance`` times the reach, and sines and cosines below ``tolerance``, to zero."""
    least = tolerance * chain.reach
    return replace(chain, links=tuple(_snap(link, least, tolerance) for link in chain.links), between=())


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
    """Copy the zeros and ones of the numeric chain ``decided`` into ``exact``, the same arm in exact numbers.

    The closed form was chosen for the zeros of ``decided``, so the exact chain must have the same ones.
    """

    def number(x: Number, value: float) -> Number:
        return sp.Integer(int(value)) if value in (0.0, 1.0, -1.0) else x

    fields = ("d", "a", "ca", "sa", "ct", "st")
    links = tuple(
        Link(*(number(getattr(link, f), float(getattr(like, f))) for f in fields))
        for link, like in zip(exact.links, decided.links, strict=True)
    )
    return replace(exact, links=links)
