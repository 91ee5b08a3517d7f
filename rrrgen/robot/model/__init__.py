"""The exact model of a robot: geometry in a normal form, standard inertial parameters, terms of the drives."""

from rrrgen.robot.model.canonical_frames import JointModel, RigidTransform, RobotModel, build_model, cosine_sine

__all__ = ["JointModel", "RigidTransform", "RobotModel", "build_model", "cosine_sine"]
