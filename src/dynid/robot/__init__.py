"""The arm: kinematics, mounting, limits, drives, prior inertias.

Start with `dynid.robot.load.load_robot`.
"""

from dynid.robot.body import Body, box_points, cylinder_points
from dynid.robot.dh import robot_from_chain, robot_from_dh
from dynid.robot.kinematics import (
    joint_poses,
    nominal_geometry,
    structural_gravity,
    with_mount,
)
from dynid.robot.load import (
    BuiltinRobot,
    RobotLike,
    builtin_names,
    load_robot,
    robot_from_json,
    robot_to_json,
    robots,
)
from dynid.robot.model import (
    Counterbalance,
    Drives,
    JointLimits,
    RobotModel,
    SafetyLimits,
    Tool,
    direct_drives,
    unknown_limits,
    with_tool,
)
from dynid.robot.transforms import (
    PARAMETERS,
    PSEUDO_INERTIA_BASIS,
    frame_map,
    from_axes,
    from_body,
    from_pinocchio,
    from_pseudo_inertia,
    from_xyz_rpy,
    inverse,
    is_physical,
    move,
    parameter_frames,
    poses_at_zero,
    rotation_z,
    tensor,
    to_pseudo_inertia,
    translation,
)
from dynid.robot.urdf import robot_from_urdf
from dynid.robot.urdf_bodies import urdf_shapes

__all__ = [
    "PARAMETERS",
    "PSEUDO_INERTIA_BASIS",
    "Body",
    "BuiltinRobot",
    "Counterbalance",
    "Drives",
    "JointLimits",
    "RobotLike",
    "RobotModel",
    "SafetyLimits",
    "Tool",
    "box_points",
    "builtin_names",
    "cylinder_points",
    "direct_drives",
    "frame_map",
    "from_axes",
    "from_body",
    "from_pinocchio",
    "from_pseudo_inertia",
    "from_xyz_rpy",
    "inverse",
    "is_physical",
    "joint_poses",
    "load_robot",
    "move",
    "nominal_geometry",
    "parameter_frames",
    "poses_at_zero",
    "robot_from_chain",
    "robot_from_dh",
    "robot_from_json",
    "robot_from_urdf",
    "robot_to_json",
    "robots",
    "rotation_z",
    "structural_gravity",
    "tensor",
    "to_pseudo_inertia",
    "translation",
    "unknown_limits",
    "urdf_shapes",
    "with_mount",
    "with_tool",
]
