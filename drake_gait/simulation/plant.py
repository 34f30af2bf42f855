"""From a robot description and a foot design to a finalized plant."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.geometry import Role, SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    ForceElementIndex,
    PdControllerGains,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    SpatialInertia,
)
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, TriggerType
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from drake_gait.errors import ModelError
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, JOINTS, FloatArray
from drake_gait.robot.description import UNPACKED, Model, RobotModel, files_of, read_model
from drake_gait.robot.sdf import BASE, TOE_HINGES, remove_looks, with_files, with_friction
from drake_gait.robot.sdf_checks import tree
from drake_gait.servo import Servo
from drake_gait.simulation.collision import box_corners, out_of_reach
from drake_gait.simulation.command_source import GaitSystem
from drake_gait.simulation.contact import (
    GROUND_FRICTION,
    Plate,
    add_ground,
    add_soles,
    part_soles,
    plates,
)
from drake_gait.simulation.messages import drake_messages, in_one_line, without_folders
from drake_gait.simulation.meter import Meter
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.toes import with_toes
from drake_gait.sole import Sole
from drake_gait.walk import DEFAULT_MODEL

_NEVER: tuple[FloatArray, FloatArray] = (np.array([-np.inf]), np.array([np.inf]))

_OUT_OF_REACH = np.pi / 2.0
"""A servo never turns so far: commands stay within Table I, and a walk ends when it falls [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """The diagram of one robot on the ground, for any gait and any springs in its toes."""

    config: PlantConfig
    """What it was made from."""
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
    steps: VectorLogSink | None
    """Logs the same at the end of every step."""
    springs: tuple[RevoluteSpring, ...]
    """The toes' springs, ordered as TOE_HINGES; none where the toes are rigid."""

    @cached_property
    def meter(self) -> Meter:
        """Meter of its walks."""
        return Meter(self.plant, self.scene_graph, self.config)

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

    def scale_stall_torques(self, factor: float) -> None:
        """Change what every servo can hold, in all contexts that are made from now on."""
        if factor == 1.0:
            return
        for name in JOINTS:
            actuator = self.plant.GetJointActuatorByName(name)
            actuator.set_effort_limit(factor * actuator.effort_limit())

    def scale_masses(self, plant_context: Context, factor: float) -> None:
        """Change mass and inertia of every link, in a context."""
        if factor == 1.0:
            return
        for index in self.plant.GetBodyIndices(self.plant.GetBodyByName(BASE).model_instance()):
            body = self.plant.get_body(index)
            own = body.CalcSpatialInertiaInBodyFrame(plant_context)
            scaled = SpatialInertia(factor * own.get_mass(), own.get_com(), own.get_unit_inertia())
            body.SetSpatialInertiaInBodyFrame(plant_context, scaled)


def add_robot(
    builder: DiagramBuilder, config: PlantConfig, *, looks: bool = True
) -> tuple[MultibodyPlant, SceneGraph]:
    """Add plant and scene graph of the robot on the ground to a diagram.

    Without `looks` it has the shapes that touch only.

    Raises:
        ModelError: the description cannot be read, or is not a biped with the joints needed.
    """
    foot, sole, contact = config.foot, config.sole, config.contact
    model = read_model(config.model)
    plant, scene_graph = _empty_plant(builder, config.time_step)
    rigid = foot is not None and foot.rigid_toes
    with _naming(model), drake_messages() as messages:
        root = tree(model.content)
        if foot is not None:
            with_toes(root, foot)
        if not looks:
            remove_looks(root)
        with_friction(root, config.friction, GROUND_FRICTION)
        with files_of(model, looks=looks) as (folder, uris):
            with_files(root, uris)
            _parse(plant, root, folder)
            _check_plant(plant, rigid_toes=rigid)
            if sole is not Sole.BOXES:
                add_soles(plant, _plates(root, folder), sole, contact)
        add_ground(plant, sole, contact)
        _add_servos(plant, config.servo)
        plant.Finalize()
        _check_base(plant)
        if sole is not Sole.BOXES:
            part_soles(plant, scene_graph)
        if messages:
            raise ModelError(f": Drake says: {without_folders(messages[0])}; mend it")
    if not looks:
        # They would be looked for in every step: 3 % of a walk, whose numbers stay the same.
        for geometry in out_of_reach(plant, scene_graph):
            scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kProximity)
    return plant, scene_graph


def _empty_plant(builder: DiagramBuilder, time_step: float) -> tuple[MultibodyPlant, SceneGraph]:
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=time_step, contact_model="hydroelastic_with_fallback"),
        builder,
    )
    plant.set_name("plant")
    return plant, scene_graph


def _plates(root: ElementTree.Element, folder: Path | None) -> list[Plate]:
    """Find the plates of a description's feet in a plant that is thrown away: they come first."""
    plant, scene_graph = _empty_plant(DiagramBuilder(), 0.0)
    _parse(plant, root, folder)
    plant.Finalize()
    return plates(plant, scene_graph)


def _parse(plant: MultibodyPlant, root: ElementTree.Element, folder: Path | None) -> None:
    parser = Parser(plant)
    parser.SetStrictParsing()
    if folder is not None:
        parser.package_map().Add(UNPACKED, folder)
    parser.AddModelsFromString(ElementTree.tostring(root, encoding="unicode"), "sdf")


@contextmanager
def _naming(model: RobotModel) -> Iterator[None]:
    """Turns what is wrong with a description into one line that begins with its name."""
    try:
        yield
    except ModelError as error:
        raise ModelError(f"{model}{error}") from None
    # Drake raises a failed assertion as SystemExit.
    except (RuntimeError, SystemExit) as error:
        raise ModelError(f"{model}{in_one_line(model, str(error))}") from None


def _add_servos(plant: MultibodyPlant, servo: Servo) -> None:
    for name in JOINTS:
        joint, actuator = plant.GetJointByName(name), plant.GetJointActuatorByName(name)
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        if lower <= -_OUT_OF_REACH and upper >= _OUT_OF_REACH:
            # A limit that is never reached costs the solver a fifth of a walk's time.
            joint.set_position_limits(_NEVER[0], _NEVER[1])
        actuator.set_controller_gains(PdControllerGains(p=servo.stiffness, d=servo.damping))
        back_emf = servo.back_emf(np.array([actuator.effort_limit()]))
        damping: FloatArray = joint.default_damping_vector() + back_emf
        joint.set_default_damping_vector(damping)


def _check_plant(plant: MultibodyPlant, *, rigid_toes: bool) -> None:
    """Refuse a robot with other joints than the gaits have, before it is finalized."""
    for name in (*JOINTS, *(() if rigid_toes else TOE_HINGES)):
        joint = plant.GetJointByName(name)
        if not isinstance(joint, RevoluteJoint):
            raise ModelError(f": joint '{name}' must be revolute, got {joint.type_name()}")
    sprung = {spring.joint().name() for spring in _springs(plant)}
    for name in TOE_HINGES:
        if name not in sprung and not rigid_toes:
            raise ModelError(
                f": joint '{name}' has no spring; give its <dynamics> a <spring_stiffness> > 0"
            )
    actuated = [
        plant.get_joint_actuator(index).joint().name() for index in plant.GetJointActuatorIndices()
    ]
    if actuated != list(JOINTS):
        raise ModelError(
            f": its actuated joints must be {', '.join(JOINTS)} in this order, got "
            f"{', '.join(actuated) or 'none'}; order them so, and give others <effort>0</effort>"
        )


def _check_base(plant: MultibodyPlant) -> None:
    """Refuse a robot of which something else than the torso floats."""
    floating = sorted(plant.get_body(index).name() for index in plant.GetFloatingBaseBodies())
    if floating != [BASE]:
        raise ModelError(
            f": the '{BASE}' must float, and all other links hang on it by joints; what floats is "
            f"{', '.join(floating) or 'nothing'}"
        )


def sole_corners(robot: Robot, body: RigidBody) -> FloatArray:
    """Corners of a foot link's collision boxes in its frame p_BC [m], shape (3, 8 k)."""
    return np.hstack(list(box_corners(robot.plant, robot.scene_graph, body).values()))


def build_robot(config: PlantConfig, *, logged: bool = False) -> Robot:
    """The diagram of a robot whose servos follow a GaitSystem, for walks that nobody looks at.

    Args:
        config: What to make it from.
        logged: Whether Drake logs its states.

    Raises:
        ModelError: see `add_robot`.
    """
    builder = DiagramBuilder()
    plant, scene_graph = add_robot(builder, config, looks=False)
    gait = GaitSystem(config.servo)
    builder.AddSystem(gait)
    state = plant.get_state_output_port()
    instance = plant.GetBodyByName(BASE).model_instance()
    builder.Connect(
        gait.GetOutputPort("desired_state"), plant.get_desired_state_input_port(instance)
    )
    robot = Robot(
        config=config,
        plant=plant,
        scene_graph=scene_graph,
        gait=gait,
        frames=LogVectorOutput(state, builder, FRAME_TIME) if logged else None,
        # At the end of every step: it changes no step.
        steps=LogVectorOutput(state, builder, {TriggerType.kPerStep}) if logged else None,
        springs=() if config.foot is not None and config.foot.rigid_toes else _toe_springs(plant),
        diagram=builder.Build(),
    )
    # Back-EMF per speed is stall torque / no-load speed, which both scale: it stays.
    robot.scale_stall_torques(config.supply)
    return robot


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


def stall_torques(model: Model = DEFAULT_MODEL) -> FloatArray:
    """Return the model's effort limits [N·m], shape (10,), ordered as JOINTS.

    Raises:
        ModelError: the description cannot be used.
    """
    plant, _ = add_robot(DiagramBuilder(), PlantConfig(model=model))
    limits: FloatArray = np.array(
        [plant.GetJointActuatorByName(name).effort_limit() for name in JOINTS]
    )
    return limits
