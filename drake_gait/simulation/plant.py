"""From a robot description and a foot design to a finalized plant."""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import cast
from xml.etree import ElementTree

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.geometry import Role, SceneGraph
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    ForceElementIndex,
    Joint,
    JointActuator,
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
from drake_gait.gait import FRAME_TIME, FloatArray
from drake_gait.robot.description import UNPACKED, Model, RobotModel, files_of, read_model
from drake_gait.robot.robot_file import Others, RobotFile
from drake_gait.robot.sdf import Format, remove_looks, remove_scenery, with_files, without_springs
from drake_gait.robot.sdf_checks import checked, efforts, tree
from drake_gait.servo import Servo
from drake_gait.simulation.collision import box_corners, out_of_reach
from drake_gait.simulation.command_source import GaitSystem
from drake_gait.simulation.contact import (
    Plate,
    add_ground,
    add_soles,
    part_soles,
    plates,
    scale_friction,
    soften_boxes,
)
from drake_gait.simulation.messages import drake_messages, in_one_line, without_folders
from drake_gait.simulation.meter import Meter
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.servo_joints import ServoJoints, actuators, servo_joints
from drake_gait.simulation.toes import with_toes
from drake_gait.sole import Sole
from drake_gait.walk import DEFAULT_MODEL

_NEVER: tuple[FloatArray, FloatArray] = (np.array([-np.inf]), np.array([np.inf]))

_OUT_OF_REACH = np.pi / 2.0
"""A servo never turns so far from the standing pose: commands stay within Table I [rad]."""


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
    """Springs of designed toes, ordered as the robot's hinges; none where the toes are rigid."""

    @property
    def model(self) -> RobotModel:
        """Return the robot as it was read."""
        return read_model(self.config.model)

    @cached_property
    def joints(self) -> ServoJoints:
        """Joints that have servos."""
        return servo_joints(self.plant, self.model.robot)

    @cached_property
    def meter(self) -> Meter:
        """Meter of its walks."""
        return Meter(self.plant, self.scene_graph, self.config)

    def set_foot(self, plant_context: Context, foot: FootDesign) -> None:
        """Put the springs and dampers of a foot into a context; its shape is in the diagram."""
        if not self.springs:
            return
        hinges = self.model.robot.hinges
        values = 2 * (foot.big_toe_stiffness, foot.lesser_toes_stiffness)
        stiffness = {name: value for name, value in zip(hinges, values, strict=True) if name}
        for spring in self.springs:
            joint = spring.joint()
            spring.SetStiffness(plant_context, stiffness[joint.name()])
            damping: FloatArray = np.array([foot.toe_damping])
            joint.SetDampingVector(plant_context, damping)

    def scale_stall_torques(self, factor: float) -> None:
        """Change what every servo can hold, in all contexts that are made from now on."""
        if factor == 1.0:
            return
        for actuator in actuators(self.plant):
            actuator.set_effort_limit(factor * actuator.effort_limit())

    def scale_masses(self, plant_context: Context, factor: float) -> None:
        """Change mass and inertia of every link, in a context."""
        if factor == 1.0:
            return
        torso = self.plant.GetBodyByName(self.model.robot.torso)
        for index in self.plant.GetBodyIndices(torso.model_instance()):
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
    model, sole, contact = read_model(config.model), config.sole, config.contact
    robot = model.robot
    foot = config.foot if robot.outline is not None else None
    rigid = foot is not None and foot.rigid_toes
    plant, scene_graph = _empty_plant(builder, config.time_step)
    with _naming(model), drake_messages() as messages:
        with _described(model, foot, looks=looks) as (root, folder):
            _add_model(plant, root, model, folder)
        _check_plant(plant, robot, rigid_toes=rigid)
        if sole is not Sole.BOXES or _is_placed(model):
            feet, X_WT = _stance(model, foot.body if foot else None)
            if _is_placed(model):
                plant.SetDefaultFloatingBaseBodyPose(plant.GetBodyByName(robot.torso), X_WT)
            add_soles(plant, feet, sole, contact)
        if sole is Sole.BOXES:
            soften_boxes(plant, scene_graph, robot)
        scale_friction(plant, scene_graph, robot, config.friction)
        add_ground(plant, sole, contact)
        _add_servos(plant, config.servo, model)
        plant.Finalize()
        _check_base(plant, robot)
        if sole is not Sole.BOXES:
            part_soles(plant, scene_graph, robot)
        if messages:
            raise ModelError(f": Drake says: {without_folders(messages[0])}; mend it")
    if not looks:
        # They would be looked for in every step: 3 % of a walk, whose numbers stay the same.
        for geometry in out_of_reach(plant, scene_graph, robot):
            scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kProximity)
    return plant, scene_graph


def _empty_plant(builder: DiagramBuilder, time_step: float) -> tuple[MultibodyPlant, SceneGraph]:
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(time_step=time_step, contact_model="hydroelastic_with_fallback"),
        builder,
    )
    plant.set_name("plant")
    return plant, scene_graph


def _is_placed(model: RobotModel) -> bool:
    """Return whether the program puts a robot on the ground; others stand as their model says."""
    return model.robot.standing is not None or model.format is not Format.SDF


@contextmanager
def _described(
    model: RobotModel, foot: FootDesign | None, *, looks: bool
) -> Iterator[tuple[ElementTree.Element, Path | None]]:
    """The elements of a robot's description as it walks, and the folder with its files."""
    root = tree(model.content, model.robot)
    remove_scenery(root)
    if foot is not None:
        with_toes(root, foot, model.robot)
    if not looks:
        remove_looks(root)
    with files_of(model, looks=looks) as (folder, uris):
        if folder is not None and model.format is Format.MJCF:  # It knows no packages.
            uris = {one.uri: str(folder / one.path) for one in model.files if one.uri in uris}
        with_files(root, uris)
        yield root, folder


@lru_cache(maxsize=8)
def _stance(model: RobotModel, foot: FootDesign | None) -> tuple[tuple[Plate, ...], RigidTransform]:
    """Return the plates of a robot's feet, and where its torso stands: by a plant thrown away."""
    plant, scene_graph = _empty_plant(DiagramBuilder(), 0.0)
    with _described(model, foot, looks=False) as (root, folder):
        _add_model(plant, root, model, folder)
    plant.Finalize()
    _check_base(plant, model.robot)
    torso, context = plant.GetBodyByName(model.robot.torso), plant.CreateDefaultContext()
    X_WT = plant.EvalBodyPoseInWorld(context, torso)
    if _is_placed(model):
        bodies = [plant.GetBodyByName(link) for link in model.robot.plates]
        heights = [
            (plant.EvalBodyPoseInWorld(context, body) @ corners)[2].min()
            for body in bodies
            for corners in box_corners(plant, scene_graph, body).values()
        ]
        if not heights:
            raise ModelError(f": {_no_sole(model.robot.plates[0])}")
        lift: FloatArray = np.array([0.0, 0.0, -min(heights)])
        X_WT = RigidTransform(X_WT.rotation(), X_WT.translation() + lift)
    return tuple(plates(plant, scene_graph, model.robot)), X_WT


def _no_sole(link: str) -> str:
    return f"link '{link}' must touch the ground with a box, got none; give its collision one"


def _add_model(
    plant: MultibodyPlant, root: ElementTree.Element, model: RobotModel, folder: Path | None
) -> None:
    """Add a robot in its standing pose, its joints without a role held as its file says."""
    robot = model.robot
    if not _extra_joints(model) or robot.others is not Others.WELD:
        _parse(plant, root, model, folder)
    else:
        # Drake removes no joint where there are springs: they are added again.
        probe, _ = _empty_plant(DiagramBuilder(), 0.0)
        _parse(probe, root, model, folder)
        bare = copy.deepcopy(root)
        without_springs(bare)
        _parse(plant, bare, model, folder)
        _weld(plant, model)
        for spring in _springs(probe):
            if plant.HasJointNamed(name := spring.joint().name()):
                joint = cast(RevoluteJoint, plant.GetJointByName(name))
                rest, stiffness = spring.default_nominal_angle(), spring.default_stiffness()
                plant.AddForceElement(RevoluteSpring(joint, rest, stiffness))
    _add_toe_springs(plant, robot)
    for name, angle in robot.standing or ():
        if not plant.HasJointNamed(name):
            continue  # It is welded there.
        joint = cast(RevoluteJoint, plant.GetJointByName(name))
        _check_standing(joint, angle)
        joint.set_default_angle(angle)


def _add_toe_springs(plant: MultibodyPlant, robot: RobotFile) -> None:
    """Add the springs of toes that the robot's file tells of: Drake reads none of URDF and MJCF."""
    sprung = {spring.joint().name() for spring in _springs(plant)}
    for toe in (toe for leg in robot.legs for toe in leg.toes if toe is not None):
        joint = plant.GetJointByName(toe.hinge)
        if not isinstance(joint, RevoluteJoint):
            continue  # What is wrong with it is told later; or it is rigid.
        if toe.stiffness is not None:
            if toe.hinge in sprung:
                raise ModelError(
                    f": joint '{toe.hinge}' has a spring in the model, and another one in the "
                    "robot's file; remove one"
                )
            plant.AddForceElement(RevoluteSpring(joint, 0.0, toe.stiffness))
        if toe.damping is not None:
            damping: FloatArray = np.array([toe.damping])
            joint.set_default_damping_vector(damping)


def _check_standing(joint: Joint, angle: float) -> None:
    """Refuse an angle of the standing pose that a joint does not have."""
    if not isinstance(joint, RevoluteJoint):
        raise ModelError(
            f": joint '{joint.name()}' of standing_deg must be revolute, got {joint.type_name()}"
        )
    lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
    if not lower <= angle <= upper:
        raise ModelError(
            f": standing_deg.{joint.name()} = {np.degrees(angle):g} is outside of the joint's "
            f"limits, {np.degrees(lower):g} to {np.degrees(upper):g} degrees"
        )


def _extra_joints(model: RobotModel) -> list[str]:
    """Return the joints of a model that can turn, and that its robot's file gives no role."""
    description, robot = checked(model.content, model.robot), model.robot
    known = {*robot.joints, *robot.hinges}
    return [
        element.get("name") or ""
        for element in description.elements("joint")
        if element.get("name") not in known and element.get("type") not in ("fixed", "free")
    ]


def _weld(plant: MultibodyPlant, model: RobotModel) -> None:
    """Weld the joints without a role in the standing pose."""
    standing = dict(model.robot.standing or ())
    for name in _extra_joints(model):
        joint = plant.GetJointByName(name)
        for actuator in actuators(plant):
            if actuator.joint().name() == name:
                plant.RemoveJointActuator(actuator)
        X_FM = RigidTransform()
        if (angle := standing.get(name, 0.0)) != 0.0:
            _check_standing(joint, angle)
            axis = cast(RevoluteJoint, joint).revolute_axis()
            X_FM = RigidTransform(RotationMatrix(AngleAxis(angle, axis)))
        parent, child = joint.frame_on_parent(), joint.frame_on_child()
        plant.RemoveJoint(joint)
        plant.WeldFrames(parent, child, X_FM)


def _parse(
    plant: MultibodyPlant, root: ElementTree.Element, model: RobotModel, folder: Path | None
) -> None:
    parser = Parser(plant)
    parser.SetStrictParsing()
    if folder is not None:
        parser.package_map().Add(UNPACKED, folder)
    text = ElementTree.tostring(root, encoding="unicode")
    parser.AddModelsFromString(text, str(model.format))


@contextmanager
def _naming(model: RobotModel) -> Iterator[None]:
    """Turns what is wrong with a description into one line that begins with its name."""
    try:
        yield
    except ModelError as error:
        raise ModelError(f"{model.place}{error}") from None
    # Drake raises a failed assertion as SystemExit.
    except (RuntimeError, SystemExit) as error:
        raise ModelError(f"{model.place}{in_one_line(model, str(error))}") from None


def _add_servos(plant: MultibodyPlant, servo: Servo, model: RobotModel) -> None:
    standing = dict(model.robot.standing or ())
    _add_missing_actuators(plant, model)
    for actuator in actuators(plant):
        joint = actuator.joint()
        group, stall = model.robot.group_of(joint.name()), model.robot.stall_of(joint.name())
        if stall is not None:
            actuator.set_effort_limit(stall)
        lower, upper = joint.position_lower_limits()[0], joint.position_upper_limits()[0]
        stands = standing.get(joint.name(), 0.0)
        if lower <= stands - _OUT_OF_REACH and upper >= stands + _OUT_OF_REACH:
            # A limit that is never reached costs the solver a fifth of a walk's time.
            joint.set_position_limits(_NEVER[0], _NEVER[1])
        stiffness, damper = group.stiffness * servo.stiffness, group.damping * servo.damping
        actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damper))
        back_emf = servo.back_emf(np.array([actuator.effort_limit() / group.no_load_speed]))
        damping: FloatArray = joint.default_damping_vector() + back_emf
        joint.set_default_damping_vector(damping)


def _add_missing_actuators(plant: MultibodyPlant, model: RobotModel) -> None:
    """Give every joint that is to have a servo one; refuse those whose stall torque is unknown."""
    robot, limits = model.robot, efforts(model.content, model.robot)
    there = {actuator.joint().name(): actuator for actuator in actuators(plant)}
    wanted = [name for name in robot.joints if name is not None]
    if robot.others is Others.SERVO:
        wanted += _extra_joints(model)
    for name in wanted:
        stall = robot.stall_of(name) or limits.get(name, 0.0)
        if name not in there and stall > 0.0:
            plant.AddJointActuator(f"{name}_servo", plant.GetJointByName(name), stall)
        elif name not in there or not (robot.stall_of(name) or np.isfinite(_effort(there[name]))):
            raise ModelError(
                f": joint '{name}' has no stall torque; give it an effort limit in the model, or "
                "[servo] of the robot's file a stall_torque_n_m"
            )


def _effort(actuator: JointActuator) -> float:
    return float(actuator.effort_limit())


def _check_plant(plant: MultibodyPlant, robot: RobotFile, *, rigid_toes: bool) -> None:
    """Refuse a robot with other joints than its file says, before it is finalized."""
    hinges = [name for name in robot.hinges if name is not None and not rigid_toes]
    for name in (*robot.joints, *hinges):
        if name is None:
            continue
        joint = plant.GetJointByName(name)
        if not isinstance(joint, RevoluteJoint):
            raise ModelError(f": joint '{name}' must be revolute, got {joint.type_name()}")
    sprung = {spring.joint().name() for spring in _springs(plant)}
    for name in hinges:
        if name not in sprung:
            raise ModelError(
                f": joint '{name}' has no spring; give its <dynamics> a <spring_stiffness> > 0, or "
                "the toe of the robot's file a stiffness_n_mm_per_deg"
            )
    known = (*robot.joints, *robot.hinges)
    for actuator in actuators(plant):
        name = actuator.joint().name()
        if name in robot.hinges:
            raise ModelError(f": joint '{name}' is a toe's, and has a servo; remove its actuator")
        if name not in known and robot.others is Others.FREE:
            raise ModelError(
                f": joint '{name}' has a servo and no role; give it <effort>0</effort>, or let "
                f"others of the robot's file be '{Others.SERVO}' or '{Others.WELD}'"
            )


def _check_base(plant: MultibodyPlant, robot: RobotFile) -> None:
    """Refuse a robot of which something else than the torso floats."""
    floating = sorted(plant.get_body(index).name() for index in plant.GetFloatingBaseBodies())
    if floating != [robot.torso]:
        raise ModelError(
            f": the '{robot.torso}' must float, and all other links hang on it by joints; what "
            f"floats is {', '.join(floating) or 'nothing'}"
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
    model = read_model(config.model)
    builder, config, robot = DiagramBuilder(), replace(config, model=model), model.robot
    plant, scene_graph = add_robot(builder, config, looks=False)
    gait = GaitSystem(config.servo, len(actuators(plant)))
    builder.AddSystem(gait)
    state = plant.get_state_output_port()
    instance = plant.GetBodyByName(robot.torso).model_instance()
    builder.Connect(
        gait.GetOutputPort("desired_state"), plant.get_desired_state_input_port(instance)
    )
    rigid = config.foot is not None and config.foot.rigid_toes
    designed = robot.outline is not None and not rigid
    found = Robot(
        config=config,
        plant=plant,
        scene_graph=scene_graph,
        gait=gait,
        frames=LogVectorOutput(state, builder, FRAME_TIME) if logged else None,
        # At the end of every step: it changes no step.
        steps=LogVectorOutput(state, builder, {TriggerType.kPerStep}) if logged else None,
        springs=_toe_springs(plant, robot) if designed else (),
        diagram=builder.Build(),
    )
    # Back-EMF per speed is stall torque / no-load speed, which both scale: it stays.
    found.scale_stall_torques(config.supply)
    return found


def _toe_springs(plant: MultibodyPlant, robot: RobotFile) -> tuple[RevoluteSpring, ...]:
    """The springs of the toes, ordered as the robot's hinges."""
    by_joint = {spring.joint().name(): spring for spring in _springs(plant)}
    return tuple(by_joint[name] for name in robot.hinges if name is not None)


def _springs(plant: MultibodyPlant) -> list[RevoluteSpring]:
    elements = (
        plant.get_force_element(ForceElementIndex(index))
        for index in range(plant.num_force_elements())
    )
    return [element for element in elements if isinstance(element, RevoluteSpring)]


def stall_torques(model: Model = DEFAULT_MODEL) -> FloatArray:
    """Return the model's effort limits [N·m], shape (10,), ordered as `gait.JOINTS`.

    NaN of roles that the robot has no joint for.

    Raises:
        ModelError: the description cannot be used.
    """
    plant, _ = add_robot(DiagramBuilder(), PlantConfig(model=model))
    limits: FloatArray = np.array([actuator.effort_limit() for actuator in actuators(plant)])
    return servo_joints(plant, read_model(model).robot).limits_by_role(limits)
