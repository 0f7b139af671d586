"""Foot clean-up by inverse kinematics."""
