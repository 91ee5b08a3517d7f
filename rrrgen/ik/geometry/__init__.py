"""Geometry for inverse kinematics: the chain in normal form, its closed loop, rigid transforms, special geometry."""
