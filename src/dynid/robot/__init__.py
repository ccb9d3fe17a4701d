"""The arm: kinematics, mounting, limits, drives, prior inertias.

Start with `dynid.robot.load.load_robot`.
"""

from dynid.robot.body import Body, box_points, cylinder_points
from dynid.robot.inertia import (
    PARAMETERS,
    frame_map,
    from_body,
    from_pseudo_inertia,
    move,
    tensor,
    to_pseudo_inertia,
)
from dynid.robot.kinematics import (
    joint_poses,
    nominal_geometry,
    structural_gravity,
    with_mount,
)
from dynid.robot.load import (
    load_robot,
    robot_from_json,
    robot_to_json,
    robots,
)
from dynid.robot.model import Counterbalance, RobotModel, Tool, with_tool
from dynid.robot.tables import read_limited, shown, shown_path
from dynid.robot.transforms import (
    from_axes,
    from_xyz_rpy,
    inverse,
    translation,
)
from dynid.robot.urdf import MAX_BYTES, find_trunk, place_links
from dynid.robot.urdf_bodies import mesh_places
from dynid.robot.urdf_xml import (
    parse_root,
    parse_urdf,
    read_number,
    read_origin,
    read_vector,
)

__all__ = [
    "MAX_BYTES",
    "PARAMETERS",
    "Body",
    "Counterbalance",
    "RobotModel",
    "Tool",
    "box_points",
    "cylinder_points",
    "find_trunk",
    "frame_map",
    "from_axes",
    "from_body",
    "from_pseudo_inertia",
    "from_xyz_rpy",
    "inverse",
    "joint_poses",
    "load_robot",
    "mesh_places",
    "move",
    "nominal_geometry",
    "parse_root",
    "parse_urdf",
    "place_links",
    "read_limited",
    "read_number",
    "read_origin",
    "read_vector",
    "robot_from_json",
    "robot_to_json",
    "robots",
    "shown",
    "shown_path",
    "structural_gravity",
    "tensor",
    "to_pseudo_inertia",
    "translation",
    "with_mount",
    "with_tool",
]
