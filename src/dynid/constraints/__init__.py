"""One judge for motions: limits of joints, speed, torque and power, and collisions."""

from dynid.constraints.certificate import Certificate, certify
from dynid.constraints.collision import Bodies
from dynid.constraints.distance import closest_on_segments, place_shapes, segment_to_shape
from dynid.constraints.dynamic import prior_dynamics
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
    "Bodies",
    "Certificate",
    "ConstraintSettings",
    "MotionConstraints",
    "Scene",
    "Shape",
    "Unjudged",
    "Worst",
    "certify",
    "closest_on_segments",
    "paper_constraints",
    "place_shapes",
    "prior_dynamics",
    "safe_constraints",
    "scene_from_json",
    "segment_to_shape",
]
