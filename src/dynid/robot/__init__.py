"""The arm: kinematics, mounting, limits, drives, prior inertias.

Start with `dynid.robot.load.load_robot`.
"""

from dynid.robot.body import Body, box_points, cylinder_points, read_mesh
from dynid.robot.dh import robot_from_chain, robot_from_dh
from dynid.robot.kinematics import (
    flange_pose,
    joint_poses,
    nominal_geometry,
    structural_gravity,
    with_mount,
)
from dynid.robot.load import builtin_names, load_robot, robot_from_json, robot_to_json, robots
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
from dynid.robot.tables import read_limited, shown, shown_path
from dynid.robot.transforms import (
    PARAMETERS,
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
    to_pinocchio,
    to_pseudo_inertia,
    translation,
)
from dynid.robot.urdf import MAX_BYTES, find_trunk, load_urdf, place_links, robot_from_urdf
from dynid.robot.urdf_bodies import mesh_places
from dynid.robot.urdf_xml import parse_root, parse_urdf, read_number, read_origin, read_vector

__all__ = [
    "MAX_BYTES",
    "PARAMETERS",
    "Body",
    "Counterbalance",
    "Drives",
    "JointLimits",
    "RobotModel",
    "SafetyLimits",
    "Tool",
    "box_points",
    "builtin_names",
    "cylinder_points",
    "direct_drives",
    "find_trunk",
    "flange_pose",
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
    "load_urdf",
    "mesh_places",
    "move",
    "nominal_geometry",
    "parameter_frames",
    "parse_root",
    "parse_urdf",
    "place_links",
    "poses_at_zero",
    "read_limited",
    "read_mesh",
    "read_number",
    "read_origin",
    "read_vector",
    "robot_from_chain",
    "robot_from_dh",
    "robot_from_json",
    "robot_from_urdf",
    "robot_to_json",
    "robots",
    "rotation_z",
    "shown",
    "shown_path",
    "structural_gravity",
    "tensor",
    "to_pinocchio",
    "to_pseudo_inertia",
    "translation",
    "unknown_limits",
    "with_mount",
    "with_tool",
]
