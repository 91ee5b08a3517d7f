"""Notes to the user about entries of a robot file that an export format cannot hold."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from rrrgen.robot.spec import RobotSpec


def unused_entries(spec: RobotSpec, kept: Collection[str] = ()) -> Iterator[str]:
    """Yield one sentence for each kind of joint entry that the robot file states and the export format loses.

    ``kept`` are the keys that the format can hold, of acceleration, offset, gear_ratio, torque_constant,
    encoder_resolution, stiffness and damping.
    """
    owners = {
        "acceleration": ("limits", "limits of the acceleration"),
        "offset": ("friction", "constant torques of friction"),
        "gear_ratio": ("drive", "gear ratios"),
        "torque_constant": ("drive", "torque constants"),
        "encoder_resolution": ("drive", "resolutions of encoders"),
        "stiffness": ("drive", "stiffnesses of joints"),
        "damping": ("drive", "dampings of elastic joints"),
    }
    for key, (section, words) in owners.items():
        sections = [getattr(joint, section) for joint in spec.joints]
        if key not in kept and any(each is not None and getattr(each, key) is not None for each in sections):
            yield f"{words} are left out: the format has no such entry"
