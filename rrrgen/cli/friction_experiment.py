"""The design of the motion of one joint for a friction experiment, by ``rrrgen experiment excite --friction``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rrrgen.base.errors import option_name, require
from rrrgen.cli.arguments import described_files, print_json, read_with_warnings
from rrrgen.cli.terminal import say

if TYPE_CHECKING:
    from rrrgen.lab.studies.excite import ExciteOptions

DURATION = 40.0
OTHERS = ("harmonics", "starts", "cluster")


def excite_friction(
    robot: str, joint: str, response: str | None, options: ExciteOptions, output: Path, fresh: bool, as_json: bool
) -> int:
    """Design the friction experiment of the ``joint`` and write it to ``output``."""
    require("rrrgen experiment excite", "matplotlib")
    spec = read_with_warnings(robot)
    experiment = options.of_file(spec.n)
    others = [name for name in OTHERS if getattr(options, name) is not None]
    for name in others if response is None else (*others, "response"):
        raise click.UsageError(f"{option_name(name)} does not belong to a friction experiment")
    import numpy as np

    from rrrgen.lab.data.run_folder import RunFolder
    from rrrgen.lab.design.friction_motion import design_friction_motion
    from rrrgen.lab.design.plots import plot_joint
    from rrrgen.verify.references.newton_euler import NewtonEuler
    from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

    phi = nominal_parameters(spec)
    links = None if phi is None else NewtonEuler(chain_of(spec), phi)
    torque = None if links is None else lambda *motion: links.inverse_dynamics(*motion)
    duration = options.duration or DURATION
    motion = design_friction_motion(spec, joint, duration, experiment.seed, torque)
    settings = {"friction": joint, "duration": duration, "rate": options.rate}
    inputs = described_files(robot=Path(robot), experiment=options.experiment)
    with RunFolder(output, "excite", inputs, settings, experiment.seed, fresh) as folder:
        place = folder.write_json("friction_motion.json", motion.to_json())
        t = np.arange(round(motion.period / experiment.period)) * experiment.period
        found = motion.evaluate(t)
        n = len(motion.centre)
        header = ("t", *(f"{name}{i + 1}" for name in ("q", "dq", "ddq") for i in range(n)))
        folder.write_csv("friction_motion.csv", header, np.column_stack([t, *found]).tolist())
        own = [part[:, motion.joint] for part in found]
        folder.figure("friction_motion", plot_joint(t, own, f"joint {joint}"))
    speeds = [float(np.sqrt(np.mean(own[1][half] ** 2))) for half in (t < 0.5 * duration, t >= 0.5 * duration)]
    if as_json:
        print_json({"motion": str(place), "joint": joint, "seconds": motion.period, "rms_speeds": speeds})
    else:
        say(
            f"{motion.period:g} s of joint {joint}: multisine of {speeds[0]:.3g} rms, then slow reversals of "
            f"{speeds[1]:.3g} rms; the other joints stand still"
        )
        say(f"motion in {place}")
    return 0
