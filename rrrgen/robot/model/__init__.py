"""The exact model of a robot: geometry in a normal form, standard inertial parameters, terms of the drives."""

from rrrgen.robot.model.canonical_frames import RobotModel, build_model
from rrrgen.robot.model.exact_transforms import JointModel, RigidTransform, cosine_sine

__all__ = ["JointModel", "RigidTransform", "RobotModel", "build_model", "cosine_sine"]
