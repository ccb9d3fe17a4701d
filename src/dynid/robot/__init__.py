"""The arm: kinematics, mounting, limits, drives, prior inertias.

Start with `dynid.robot.load.load_robot`.
"""
