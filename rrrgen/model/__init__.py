"""The model: the exact normal form of a robot, its standard parameters and its drive terms."""

from rrrgen.model.robot_model import JointModel, RigidTransform, RobotModel, build_model, cosine_sine

__all__ = ["JointModel", "RigidTransform", "RobotModel", "build_model", "cosine_sine"]
