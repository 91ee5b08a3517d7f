"""Random URDF trees around one chain: special and general axes, fixed links and side branches with inertia."""

from __future__ import annotations

import numpy as np

RIGHT = (0.0, 0.0, np.pi / 2, -np.pi / 2, np.pi, np.pi / 4, 1.0471975511965976)
AXES = ("0 0 1", "0 0 -1", "1 0 0", "0 1 0", "0 -1 0", "0.6 0 0.8", "0.3 -0.5 0.2")


def body(name: str, random: np.random.Generator) -> str:
    """A link with the inertia of a cloud of points, in an inertial frame of its own."""
    if random.random() < 0.1:
        return f'<link name="{name}"/>'
    points = random.normal(size=(6, 3)) * 0.1
    tensor = sum(p @ p * np.eye(3) - np.outer(p, p) for p in points - points.mean(axis=0)) + 1e-3 * np.eye(3)
    keys = (("xx", 0, 0), ("yy", 1, 1), ("zz", 2, 2), ("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2))
    entries = " ".join(f'i{key}="{tensor[i, k]!r}"' for key, i, k in keys).replace("np.float64(", "").replace(")", "")
    rpy = " ".join(f"{x:.4f}" for x in random.normal(size=3))
    xyz = " ".join(f"{x:.3f}" for x in points.mean(axis=0))
    return (
        f'<link name="{name}"><inertial><origin xyz="{xyz}" rpy="{rpy}"/>'
        f'<mass value="{random.uniform(0.1, 3):.3f}"/><inertia {entries}/></inertial></link>'
    )


def joint(name: str, kind: str, parent: str, child: str, random: np.random.Generator) -> str:
    if random.random() < 0.7:
        rpy, xyz = random.choice(RIGHT, 3), random.choice([0, 0, 0.1, 0.25, -0.4], 3)
    else:
        rpy, xyz = random.normal(size=3), random.normal(size=3) * 0.3
    origin = f'<origin xyz="{" ".join(f"{x:.6g}" for x in xyz)}" rpy="{" ".join(repr(float(x)) for x in rpy)}"/>'
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    axis = "" if kind == "fixed" else f'<axis xyz="{random.choice(AXES)}"/>'
    limit = '<limit lower="-2" upper="2" effort="10" velocity="3"/>' if kind in ("revolute", "prismatic") else ""
    return f'<joint name="{name}" type="{kind}">{origin}{ends}{axis}{limit}</joint>'


def random_tree(seed: int) -> tuple[str, str]:
    """The text of a URDF, and the tip of its chain."""
    random = np.random.default_rng(seed)
    parts, last = [body("base", random)], "base"
    for i in range(int(random.integers(2, 8))):
        name = f"link{i}"
        kind = str(random.choice(["revolute", "continuous", "prismatic"], p=[0.5, 0.3, 0.2]))
        parts += [body(name, random), joint(f"j{i}", kind, last, name, random)]
        last = name
        for extra in ("fixed", "revolute"):
            if random.random() < 0.3:
                parts += [
                    body(f"{name}_{extra}", random),
                    joint(f"{name}_{extra}", extra, name, f"{name}_{extra}", random),
                ]
        if random.random() < 0.3:
            parts += [body(f"{name}_flange", random), joint(f"f{i}", "fixed", last, f"{name}_flange", random)]
            last = f"{name}_flange"
    return f'<robot name="random">{"".join(parts)}</robot>', last
