"""From a robot description and a foot design to a finalized plant."""

import logging
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    HalfSpace,
    ProximityProperties,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    ForceElementIndex,
    PdControllerGains,
    RevoluteSpring,
    RigidBody,
)
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, JOINTS, FloatArray
from drake_gait.servo import Servo
from drake_gait.simulation.collision import box_corners, out_of_reach
from drake_gait.simulation.command_source import GaitSystem
from drake_gait.simulation.toes import with_toes
from drake_gait.walk import DEFAULT_MODEL

TOE_HINGES = tuple(
    f"{toe}_hinge_{side}" for side in ("r", "l") for toe in ("big_toe", "lesser_toes")
)
"""The four passive joints, in the order of every array of toe values."""

_DRAKE = "http://drake.mit.edu"
"""Namespace of Drake's own elements in an SDF file."""

_NEVER: tuple[FloatArray, FloatArray] = (np.array([-np.inf]), np.array([np.inf]))

GROUND_FRICTION = 1.0
"""Both coefficients of the ground; Drake combines two surfaces as 2ab / (a + b)."""


def models_folder() -> Path:
    """Folder of the robot descriptions: inside an installed package, or beside it in a checkout."""
    inside = Path(str(files("drake_gait"))) / "models"
    return inside if inside.is_dir() else inside.parents[1] / "models"


def model_path(model: str | Path = DEFAULT_MODEL) -> Path:
    """Path of a robot description, given as a file or as the name of one that is shipped.

    Raises:
        ModelError: there is no such file.
    """
    shipped = models_folder() / model
    for path in (Path(model), shipped):
        if path.is_file():
            return path
    known = ", ".join(sorted(path.name for path in models_folder().glob("*.sdf")))
    raise ModelError(
        f"no robot description '{model}'; give a path to an SDF file, or one of {known}"
    )


def with_friction(sdf: str, factor: float) -> str:
    """A robot description whose contact with the ground has `factor` times its friction.

    Raises:
        ModelError: it has a friction that is no number, or that cannot be multiplied by so much.
    """
    if factor == 1.0:
        return sdf
    ElementTree.register_namespace("drake", _DRAKE)
    root = ElementTree.fromstring(sdf)
    for name in ("mu_static", "mu_dynamic"):
        for element in root.iter(f"{{{_DRAKE}}}{name}"):
            element.text = repr(_surface(name, element.text, factor))
    return ElementTree.tostring(root, encoding="unicode")


def _surface(name: str, text: str | None, factor: float) -> float:
    """Coefficient of a surface whose contact with the ground has `factor` times its friction."""
    try:
        surface = float(text or "")
    except ValueError:
        raise ModelError(f"<drake:{name}> must be a number, got '{text or ''}'") from None
    contact = factor * 2.0 * surface * GROUND_FRICTION / (surface + GROUND_FRICTION)
    if not contact < 2.0 * GROUND_FRICTION:
        raise ModelError(
            f"no surface has {factor:g} times the friction of <drake:{name}> {surface:g} on the "
            "ground; lower walk.friction"
        )
    return contact * GROUND_FRICTION / (2.0 * GROUND_FRICTION - contact)


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """The diagram of one robot on the ground, for any gait and any springs in its toes."""

    diagram: Diagram
    """Gait system, plant and scene graph."""
    plant: MultibodyPlant
    """The robot and the ground; continuous, named "plant", as CENIC requires."""
    scene_graph: SceneGraph
    """Its shapes."""
    gait: GaitSystem
    """Sends the commands."""
    frames: VectorLogSink | None
    """Logs positions, then velocities, of the plant at the control frames, where it is `logged`."""
    springs: tuple[RevoluteSpring, ...]
    """The toes' springs, ordered as TOE_HINGES; none where the toes are rigid."""

    def set_foot(self, plant_context: Context, foot: FootDesign) -> None:
        """Put the springs and dampers of a foot into a context; its shape is in the diagram."""
        if not self.springs:
            return
        stiffness = (foot.big_toe_stiffness, foot.lesser_toes_stiffness)
        for hinge, spring, value in zip(TOE_HINGES, self.springs, 2 * stiffness, strict=True):
            spring.SetStiffness(plant_context, value)
            joint = self.plant.GetJointByName(hinge)
            damping: FloatArray = np.array([foot.toe_damping])
            joint.SetDampingVector(plant_context, damping)


def add_robot(
    builder: DiagramBuilder,
    model: str | Path,
    foot: FootDesign,
    servo: Servo,
    *,
    time_step: float = 0.0,
    looks: bool = True,
    friction: float = 1.0,
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add plant and scene graph of the robot on the ground to a diagram.

    The plant is continuous, or, with a `time_step` [s], discrete with Drake's lagged solver.
    Without `looks` it has the shapes that touch only.
    The friction between feet and ground is `friction` times that of the description.

    Raises:
        ModelError: the description cannot be read, or is not a biped with the joints needed.
    """
    path = model_path(model)
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=time_step, contact_model="hydroelastic_with_fallback"),
        builder,
    )
    plant.set_name("plant")
    parser = Parser(plant)
    parser.SetStrictParsing()
    parser.package_map().AddPackageXml(models_folder() / "package.xml")
    try:
        sdf = with_friction(with_toes(path.read_text(), foot, looks=looks), friction)
        parser.AddModelsFromString(sdf, "sdf")
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    except ElementTree.ParseError as error:
        raise ModelError(f"{path} is not a well-formed SDF file: {error}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"cannot read {path}: {error}") from None
    except RuntimeError as error:
        first_line = str(error).strip().splitlines()[0]
        raise ModelError(f"{path} is not a robot that can be used: {first_line}") from None
    _check_joints(plant, path, foot)
    add_ground(plant)
    for name in JOINTS:
        # Commands stay within Table I, and a limit costs the solver a fifth of a walk's time.
        plant.GetJointByName(name).set_position_limits(_NEVER[0], _NEVER[1])
        actuator = plant.GetJointActuatorByName(name)
        actuator.set_controller_gains(PdControllerGains(p=servo.stiffness, d=servo.damping))
        back_emf = actuator.effort_limit() / servo.no_load_speed
        plant.GetJointByName(name).set_default_damping(back_emf)
    plant.Finalize()
    if not looks:
        # They would be looked for in every step: 3 % of a walk, whose numbers stay the same.
        for geometry in out_of_reach(plant, scene_graph):
            scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kProximity)
    return plant, scene_graph


def _check_joints(plant: MultibodyPlant, path: Path, foot: FootDesign) -> None:
    present = [plant.get_joint(index).name() for index in plant.GetJointIndices()]
    for name in (*JOINTS, *TOE_HINGES):
        if name not in present:
            raise ModelError(f"no joint '{name}' in {path}; it has {', '.join(present) or 'none'}")
    sprung = {spring.joint().name() for spring in _springs(plant)}
    for name in TOE_HINGES:
        if name not in sprung and not foot.rigid_toes:
            raise ModelError(f"joint '{name}' in {path} has no spring (<spring_stiffness>)")
    actuated = [
        plant.get_joint_actuator(index).joint().name() for index in plant.GetJointActuatorIndices()
    ]
    if actuated != list(JOINTS):
        raise ModelError(
            f"the actuated joints of {path} must be {', '.join(JOINTS)} in this order; "
            f"they are {', '.join(actuated) or 'none'}"
        )


def add_ground(plant: MultibodyPlant) -> None:
    """A rigid half space under z = 0."""
    properties = ProximityProperties()
    AddRigidHydroelasticProperties(properties)
    AddContactMaterial(
        friction=CoulombFriction(GROUND_FRICTION, GROUND_FRICTION), properties=properties
    )
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "ground", properties
    )


def sole_corners(robot: Robot, body: RigidBody) -> FloatArray:
    """Corners of a foot link's collision boxes in its frame p_BC [m], shape (3, 8 k)."""
    return np.hstack(list(box_corners(robot.plant, robot.scene_graph, body).values()))


# Drake warns that deformable bodies will not touch the ground; there are none.
logging.getLogger("drake").addFilter(lambda record: "deformable contact" not in record.getMessage())


def build_robot(
    model: str | Path,
    foot: FootDesign,
    servo: Servo,
    *,
    time_step: float = 0.0,
    friction: float = 1.0,
    logged: bool = False,
) -> Robot:
    """The diagram of a robot whose servos follow a GaitSystem, for walks that nobody looks at.

    Raises:
        ModelError: see `add_robot`.
    """
    builder = DiagramBuilder()
    plant, scene_graph = add_robot(
        builder, model, foot, servo, time_step=time_step, friction=friction, looks=False
    )
    gait = GaitSystem()
    builder.AddSystem(gait)
    state = plant.get_state_output_port()
    frames = LogVectorOutput(state, builder, FRAME_TIME) if logged else None
    instance = plant.GetBodyByName("torso").model_instance()
    builder.Connect(
        gait.GetOutputPort("desired_state"), plant.get_desired_state_input_port(instance)
    )
    return Robot(
        diagram=builder.Build(),
        plant=plant,
        scene_graph=scene_graph,
        gait=gait,
        frames=frames,
        springs=() if foot.rigid_toes else _toe_springs(plant),
    )


def _toe_springs(plant: MultibodyPlant) -> tuple[RevoluteSpring, ...]:
    """The plant's springs, ordered as TOE_HINGES."""
    by_joint = {spring.joint().name(): spring for spring in _springs(plant)}
    return tuple(by_joint[name] for name in TOE_HINGES)


def _springs(plant: MultibodyPlant) -> list[RevoluteSpring]:
    elements = (
        plant.get_force_element(ForceElementIndex(index))
        for index in range(plant.num_force_elements())
    )
    return [element for element in elements if isinstance(element, RevoluteSpring)]


def stall_torques(model: str | Path = DEFAULT_MODEL) -> FloatArray:
    """What each servo can hold [N·m], shape (10,), ordered as JOINTS: the model's effort limits.

    Raises:
        ModelError: the description cannot be used.
    """
    plant, _ = add_robot(DiagramBuilder(), model, FootDesign(), Servo())
    limits: FloatArray = np.array(
        [plant.GetJointActuatorByName(name).effort_limit() for name in JOINTS]
    )
    return limits
