"""The arm: kinematics, mounting, limits, drives, prior inertias.

Start with `dynid.robot.load.load_robot`.
"""

from dynid.robot.body import Body as Body
from dynid.robot.body import box_points as box_points
from dynid.robot.body import cylinder_points as cylinder_points
from dynid.robot.body import hull_faces as hull_faces
from dynid.robot.kinematics import joint_poses as joint_poses
from dynid.robot.kinematics import joint_turns as joint_turns
from dynid.robot.kinematics import nominal_geometry as nominal_geometry
from dynid.robot.kinematics import robot_from_chain as robot_from_chain
from dynid.robot.kinematics import robot_from_dh as robot_from_dh
from dynid.robot.kinematics import structural_gravity as structural_gravity
from dynid.robot.kinematics import with_mount as with_mount
from dynid.robot.load import BuiltinRobot as BuiltinRobot
from dynid.robot.load import RobotLike as RobotLike
from dynid.robot.load import load_robot as load_robot
from dynid.robot.load import robot_from_json as robot_from_json
from dynid.robot.load import robot_to_json as robot_to_json
from dynid.robot.load import robots as robots
from dynid.robot.model import STANDARD_GRAVITY as STANDARD_GRAVITY
from dynid.robot.model import UNLIMITED as UNLIMITED
from dynid.robot.model import Counterbalance as Counterbalance
from dynid.robot.model import Drives as Drives
from dynid.robot.model import JointLimits as JointLimits
from dynid.robot.model import RobotModel as RobotModel
from dynid.robot.model import SafetyLimits as SafetyLimits
from dynid.robot.model import Tool as Tool
from dynid.robot.model import carried as carried
from dynid.robot.model import joints_by_kind as joints_by_kind
from dynid.robot.model import with_carried as with_carried
from dynid.robot.model import with_tool as with_tool
from dynid.robot.robotfile import builtin_names as builtin_names
from dynid.robot.transforms import PARAMETER_UNITS as PARAMETER_UNITS
from dynid.robot.transforms import PARAMETERS as PARAMETERS
from dynid.robot.transforms import PSEUDO_INERTIA_BASIS as PSEUDO_INERTIA_BASIS
from dynid.robot.transforms import frame_map as frame_map
from dynid.robot.transforms import from_axes as from_axes
from dynid.robot.transforms import from_body as from_body
from dynid.robot.transforms import from_pseudo_inertia as from_pseudo_inertia
from dynid.robot.transforms import from_xyz_rpy as from_xyz_rpy
from dynid.robot.transforms import inverse as inverse
from dynid.robot.transforms import is_physical as is_physical
from dynid.robot.transforms import move as move
from dynid.robot.transforms import parameter_frames as parameter_frames
from dynid.robot.transforms import poses_at_zero as poses_at_zero
from dynid.robot.transforms import require_rigid as require_rigid
from dynid.robot.transforms import rotation_z as rotation_z
from dynid.robot.transforms import tensor as tensor
from dynid.robot.transforms import to_pseudo_inertia as to_pseudo_inertia
from dynid.robot.transforms import translation as translation
from dynid.robot.urdf import UrdfLink as UrdfLink
from dynid.robot.urdf import robot_from_urdf as robot_from_urdf
from dynid.robot.urdf import urdf_links as urdf_links
from dynid.robot.urdf_bodies import urdf_shapes as urdf_shapes
from dynid.robot.urdf_xml import parse_xml as parse_xml
