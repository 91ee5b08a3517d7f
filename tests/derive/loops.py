"""Robot files with closed loops: four-bar, five-bar, slider-crank, cylinder, and loops on the links of others."""

from __future__ import annotations

from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PALLETISER = EXAMPLES / "palletiser" / "unequal.yaml"

_HEAD = "schema: rrrgen/1\nname: {name}\nconvention: {convention}\nunits: {{angle: deg, length: m}}\n"
_LINK = "  - {{mass: {0}, com: [0.{0}, 0.02, 0.01], inertia: {{about: com, xx: 0.0{0}1, yy: 0.0{0}2, zz: 0.0{0}2}}}}\n"


def links(count: int) -> str:
    """The section ``links`` with so many links."""
    return "links:\n" + "".join(_LINK.format(k) for k in range(1, count + 1))


def _example(name: str) -> str:
    """The text of the robot file ``name`` of the examples."""
    return (EXAMPLES / "linkages" / f"{name}.yaml").read_text(encoding="utf-8")


FOUR_BAR = _example("four_bar")
"""A crank of 0.2 m that turns fully, a rod of 0.6 m and a rocker of 0.4 m on a base of 0.5 m, in a vertical plane."""

FIVE_BAR = _example("five_bar")
"""Two drives on one axis, as in a palletiser without column, in a vertical plane."""

STACKED = (
    _HEAD.format(name="stacked", convention="modified")
    + """\
gravity: [1, -2, -9.81]
joints:
  - {name: yaw, type: revolute, alpha: 0, a: 0, d: 0.2}
  - {name: crank, type: revolute, alpha: 90, a: 0.05, d: 0.02}
  - {name: rod, type: revolute, alpha: 0, a: 0.2, d: 0, sign: -1}
  - {name: rocker, type: revolute, alpha: 90, a: 0.55, d: 0, theta: 20, parent: yaw}
  - {name: second, type: revolute, alpha: 0, a: 0.3, d: 0.01}
  - {name: link, type: revolute, alpha: 0, a: 0.5, d: 0, parent: crank}
  - {name: leaf, type: revolute, alpha: 30, a: 0.1, d: 0, parent: second, follows: {second: 2, crank: -1}}
loops:
  upper:
    passive: [second, link]
    pins: {link: [0.45, 0.1, 0], second: [0.4, 0, 0]}
    assembly: -1
  lower:
    passive: [rod, rocker]
    pins: {rod: [0.6, 0, 0], rocker: [0.4, 0.05, 0]}
    assembly: +1
tip: leaf
"""
    + links(7)
)
"""A four-bar on a column, and a second loop between its rocker and an arm on its crank; a leaf follows the second."""

SLIDER_CRANK = _example("slider_crank")
"""A crank of 0.2 m, a rod of 0.6 m, and a slider along x, 0.05 m above the pivot of the crank, in a vertical plane."""

CYLINDER = (
    _HEAD.format(name="cylinder", convention="standard")
    + """\
gravity: [0, -9.81, 0]
joints:
  - {name: boom, type: revolute, alpha: 0, a: 1.2, d: 0}
  - {name: bracket, type: revolute, alpha: 0, a: 0.4, d: 0, theta: -60, parent: base, follows: {}}
  - {name: barrel, type: revolute, alpha: 90, a: 0.04, d: 0, theta: 30}
  - {name: piston, type: prismatic, alpha: -90, a: 0, theta: 0}
loops:
  lift:
    passive: [barrel, piston]
    pins: {piston: [0, 0, 0], boom: [-0.6, -0.2, 0]}
    assembly: +1
base: {translation: [0.1, 0.3, 0]}
tip: boom
"""
    + links(4)
)
"""A boom, and a cylinder between the base and the boom, whose axis passes 0.04 m beside its joint on the base."""

SLIDES = (
    _HEAD.format(name="slides", convention="modified")
    + """\
gravity: [1, -2, -9.81]
joints:
  - {name: yaw, type: revolute, alpha: 0, a: 0, d: 0.2}
  - {name: crank, type: revolute, alpha: 90, a: 0.05, d: 0.02, drive: {inertia: 0.1}}
  - {name: slider, type: prismatic, gamma: 90, alpha: 60, a: 0.05, theta: 30, d: 0.1, sign: -1, parent: yaw}
  - {name: rod, type: revolute, gamma: 60, alpha: 90, a: 0.02, d: 0, theta: 10}
  - {name: stage, type: prismatic, alpha: 0, a: 0.3, theta: 0, follows: {slider: 1/2}, parent: slider}
  - {name: barrel, type: revolute, alpha: 0, a: 0.3, d: 0, sign: -1, parent: crank}
  - {name: piston, type: prismatic, alpha: 90, a: 0.03, theta: 0, d: 0.1}
  - {name: leaf, type: revolute, alpha: 40, a: 0.1, d: 0, parent: piston, follows: {barrel: 2, crank: -1}}
loops:
  strut:
    passive: [piston, barrel]
    pins: {piston: [0.01, 0, 0.05], slider: [0.02, 0.8, 0.1]}
    assembly: +1
  bars:
    passive: [slider, rod]
    pins: {rod: [0.6, 0.1, 0], crank: [0.2, 0.1, 0]}
    assembly: -1
tip: leaf
"""
    + links(8)
)
"""A slider-crank on a column, and a cylinder between its crank and its slider; a stage and a leaf follow both."""

_NEWTON = "    solve: newton\n    start: {{{0}: {1}, {2}: {3}}}\n"

SIX_BAR = (
    _HEAD.format(name="six_bar", convention="modified")
    + """\
gravity: [0, -9.81, 0]
joints:
  - {name: crank, type: revolute, alpha: 0, a: 0, d: 0}
  - {name: coupler, type: revolute, alpha: 0, a: 0.2, d: 0}
  - {name: rocker, type: revolute, alpha: 0, a: 0.5, d: 0, parent: base}
  - {name: link, type: revolute, alpha: 0, a: 0.35, d: 0, parent: coupler}
  - {name: leaf, type: revolute, alpha: 0, a: 0.7, d: 0, parent: base}
loops:
  first:
    passive: [coupler, rocker]
    pins: {coupler: [0.6, 0, 0], rocker: [0.4, 0, 0]}
    assembly: +1
  second:
    passive: [link, leaf]
    pins: {link: [0.5, 0, 0], leaf: [0.45, 0, 0]}
    assembly: +1
tip: link
tool: {translation: [0.3, 0.2, 0]}
"""
    + links(5)
)
"""A four-bar, and a second loop from its coupler to the base: two dyads, one after the other."""

SIX_BAR_BY_NEWTON = SIX_BAR.replace("    assembly: +1\n", _NEWTON.format("coupler", 40, "rocker", 60), 1).replace(
    "    assembly: +1\n", _NEWTON.format("link", -15, "leaf", 55)
)
"""The same mechanism, assembled as there, solved by Newton's method."""

COUPLED = _example("six_bar")
"""A six-bar whose drive is its last link: no order of dyads solves it."""

TOGGLE = (
    _HEAD.format(name="toggle", convention="modified").replace("length: m", "length: mm")
    + """\
gravity: [1, -2, -9.81]
joints:
  - {name: yaw, type: revolute, alpha: 0, a: 0, d: 200}
  - {name: crank, type: revolute, alpha: 90, a: 50, d: 20, limits: {lower: 20, upper: 100}, drive: {inertia: 0.1}}
  - {name: coupler, type: revolute, alpha: 0, a: 200, d: 0, sign: -1}
  - {name: rocker, type: revolute, alpha: 90, a: 550, d: 0, theta: 20, parent: yaw}
  - {name: link, type: revolute, alpha: 0, a: 350, d: 10, parent: coupler}
  - {name: ram, type: prismatic, alpha: 0, a: 900, theta: 0, parent: yaw}
  - {name: leaf, type: revolute, alpha: 40, a: 100, d: 0, parent: link, follows: {link: 1/2, crank: -1}}
loops:
  first:
    passive: [coupler, rocker]
    pins: {coupler: [600, 0, 0], rocker: [400, 0, 0]}
    solve: newton
    start: {coupler: -20, rocker: 80}
  second:
    passive: [link, ram]
    pins: {link: [500, 0, 0], ram: [0, 0, 0]}
    solve: newton
    start: {link: -30, ram: 400}
tip: leaf
tool: {translation: [30, 20, 0]}
"""
    + links(7).replace("[0.", "[")
)
"""A toggle press on a column, in mm: a four-bar, and a ram that its coupler moves; a leaf follows the link by half."""
