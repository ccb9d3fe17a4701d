"""A simulated arm with known parameters, to test identification against."""

from dynid.simulation.joints import JointFriction as JointFriction
from dynid.simulation.joints import JointSensors as JointSensors
from dynid.simulation.joints import JointThermal as JointThermal
from dynid.simulation.joints import PlantState as PlantState
from dynid.simulation.joints import Servo as Servo
from dynid.simulation.joints import Target as Target
from dynid.simulation.joints import Thermal as Thermal
from dynid.simulation.kernel import mujoco_model as mujoco_model
from dynid.simulation.library import SERIAL as SERIAL
from dynid.simulation.library import GroundTruth as GroundTruth
from dynid.simulation.library import SimulatedArm as SimulatedArm
from dynid.simulation.library import cylinder as cylinder
from dynid.simulation.library import link_body as link_body
from dynid.simulation.library import link_parameters as link_parameters
from dynid.simulation.library import point_masses as point_masses
from dynid.simulation.library import simulated_arm as simulated_arm
from dynid.simulation.library import ur5_truth as ur5_truth
from dynid.simulation.library import with_payload as with_payload
from dynid.simulation.plant import SimulatedPlant as SimulatedPlant
from dynid.simulation.plant import SimulatedRun as SimulatedRun
from dynid.simulation.plant import recorded as recorded
from dynid.simulation.plant import simulate as simulate
from dynid.simulation.plant import stacked as stacked
from dynid.simulation.plant import warm_up as warm_up
