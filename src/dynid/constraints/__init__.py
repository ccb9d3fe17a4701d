"""One judge for motions: limits of joints, speed, torque and power, and collisions."""

from dynid.constraints.bodies import least_distance
from dynid.constraints.certificate import Certificate, certify
from dynid.constraints.collision import CollisionBodies, JudgedPairs, Proximity
from dynid.constraints.dynamic import prior_dynamics, prior_link
from dynid.constraints.limits import DISTANCES, RATIOS, Unjudged, Worst
from dynid.constraints.motion import (
    CLEARANCE,
    MARGIN,
    PRESETS,
    MotionConstraints,
    paper_constraints,
    safe_constraints,
)
from dynid.constraints.scene import (
    BOX,
    CYLINDER,
    FLOORS,
    HALF_SPACE,
    SPHERE,
    ConstraintSettings,
    Scene,
    Shape,
    body_of,
    read_scene,
    scene_from_json,
)

__all__ = [
    "BOX",
    "CLEARANCE",
    "CYLINDER",
    "DISTANCES",
    "FLOORS",
    "HALF_SPACE",
    "MARGIN",
    "PRESETS",
    "RATIOS",
    "SPHERE",
    "Certificate",
    "CollisionBodies",
    "ConstraintSettings",
    "JudgedPairs",
    "MotionConstraints",
    "Proximity",
    "Scene",
    "Shape",
    "Unjudged",
    "Worst",
    "body_of",
    "certify",
    "least_distance",
    "paper_constraints",
    "prior_dynamics",
    "prior_link",
    "read_scene",
    "safe_constraints",
    "scene_from_json",
]
