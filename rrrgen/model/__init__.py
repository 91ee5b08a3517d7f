"""From a robot's description to its exact normal form."""

from rrrgen.model.robot_model import JointModel, RigidTransform, RobotModel, build_model, cosine_sine

__all__ = ["JointModel", "RigidTransform", "RobotModel", "build_model", "cosine_sine"]
