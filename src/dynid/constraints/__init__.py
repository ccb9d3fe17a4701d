"""One judge for motions: limits of joints, speed, torque and power, and collisions."""

from dynid.constraints.certificate import Certificate, certify
from dynid.constraints.collision import Bodies
from dynid.constraints.distance import closest_on_segments, place_shapes, segment_to_shape
from dynid.constraints.dynamic import prior_dynamics, prior_link
from dynid.constraints.limits import DISTANCES, RATIOS, Worst
from dynid.constraints.motion import (
    PRESETS,
    MotionConstraints,
    paper_constraints,
    safe_constraints,
)
from dynid.constraints.scene import (
    BOX,
    CYLINDER,
    HALF_SPACE,
    SPHERE,
    ConstraintSettings,
    Scene,
    Shape,
    scene_from_json,
)

__all__ = [
    "BOX",
    "CYLINDER",
    "DISTANCES",
    "HALF_SPACE",
    "PRESETS",
    "RATIOS",
    "SPHERE",
    "Bodies",
    "Certificate",
    "ConstraintSettings",
    "MotionConstraints",
    "Scene",
    "Shape",
    "Worst",
    "certify",
    "closest_on_segments",
    "paper_constraints",
    "place_shapes",
    "prior_dynamics",
    "prior_link",
    "safe_constraints",
    "scene_from_json",
    "segment_to_shape",
]
