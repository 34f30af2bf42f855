"""Laws of mechanics that every simulated walk must keep."""

from collections.abc import Sequence

import numpy as np
import pytest
from pydrake.geometry import Box, ProximityProperties
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from strides import MIDDLE

from drake_gait import Candidate, FootDesign, Gait, WalkSettings, simulate
from drake_gait.foot import N_MM_PER_DEG
from drake_gait.gait import FRAMES, JOINTS, FloatArray
from drake_gait.robot.robot_file import default_robot
from drake_gait.servo import Servo
from drake_gait.simulation.measures import swing_clearance
from drake_gait.simulation.observer import Observer
from drake_gait.simulation.plant import Robot, add_ground, build_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.simulate import follow, start
from drake_gait.walk import Fidelity, Integrator, Walk

STANDING_STILL = np.zeros((FRAMES + 1, len(JOINTS)))
WEIGHT = 1.5 * 9.81
REFERENCE = WalkSettings(fidelity=Fidelity.REFERENCE)
PRECISE = Integrator(step=0.01, accuracy=1e-5)


def mirrored(commands: FloatArray) -> FloatArray:
    """The commands of the robot in a mirror: legs exchanged, roll to the other side."""
    other_side = {"r": "l", "l": "r"}
    twins = [JOINTS.index(name[:-1] + other_side[name[-1]]) for name in JOINTS]
    signs = [-1.0 if "roll" in name else 1.0 for name in JOINTS]
    return np.array(commands[:, twins] * signs)


def wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


# --- Standing -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "fidelity", [Fidelity.SEARCH, pytest.param(Fidelity.REFERENCE, marks=pytest.mark.slow)]
)
def test_a_standing_robot_stays_where_and_as_high_as_it_is(fidelity: Fidelity) -> None:
    walk = follow(STANDING_STILL, settings=WalkSettings(fidelity=fidelity), history=True)
    assert walk.survived
    assert walk.history is not None
    drift = walk.history.com - walk.history.com[0]
    assert np.linalg.norm(drift[:, :2], axis=1).max() < 1e-3
    assert np.abs(walk.history.com[:, 2] - 0.245).max() < 0.5e-3


def test_the_ground_carries_the_weight_of_a_standing_robot() -> None:
    history = follow(STANDING_STILL, history=True).history
    assert history is not None
    vertical = history.ground_reaction[:, :, 2].sum(axis=1)
    assert vertical.mean() == pytest.approx(WEIGHT, rel=0.01)
    # Both legs alike, as the robot is symmetric.
    assert history.ground_reaction[:, 0, 2].mean() == pytest.approx(WEIGHT / 2.0, rel=0.02)


@pytest.fixture(scope="module")
def reference() -> Walk:
    """A walk at reference fidelity: a step of 4 ms that meets an impact reads a peak at its end."""
    return simulate(Candidate(gait=MIDDLE), REFERENCE, history=True)


def test_foot_loads_average_to_the_weight_over_a_walk(reference: Walk) -> None:
    assert reference.history is not None
    vertical = reference.history.ground_reaction[:, :, 2].sum(axis=1)
    # The robot ends at rest as it began: impulse = weight x time.
    assert vertical.mean() == pytest.approx(WEIGHT, rel=0.03)


def test_a_standing_robot_gains_no_energy() -> None:
    robot = build_robot(PlantConfig())
    simulator, context = prepared(robot)
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    # The sum leaves out what the soles store, so the robot has to have stopped rocking on them.
    simulator.AdvanceTo(1.5)
    energies = []
    for time in np.arange(1.6, 3.6, 0.1):
        simulator.AdvanceTo(time)
        energies.append(mechanical_energy(robot, plant_context))
    assert max(energies) - energies[0] < 1e-5
    assert energies[-1] <= energies[0] + 1e-6


# --- Symmetry -------------------------------------------------------------------------------------


def test_a_mirrored_gait_walks_a_mirrored_path() -> None:
    commands = MIDDLE.commands
    walk = follow(commands, settings=REFERENCE)
    twin = follow(mirrored(commands), settings=REFERENCE)
    # The meshes of the soles are mirrored too (tools/make_models.py); without: 8 mm, 4 degrees.
    assert twin.forward == pytest.approx(walk.forward, abs=2e-3)
    assert twin.lateral == pytest.approx(-walk.lateral, abs=3e-3)
    assert wrapped(twin.yaw + walk.yaw) == pytest.approx(0.0, abs=np.radians(1.5))


@pytest.mark.slow
def test_a_finer_simulation_walks_about_as_far() -> None:
    coarse = simulate(Candidate(gait=MIDDLE))
    fine = simulate(Candidate(gait=MIDDLE), REFERENCE)
    assert fine.survived
    assert fine.forward == pytest.approx(coarse.forward, abs=0.03)


@pytest.mark.slow
def test_a_millionth_of_a_degree_changes_nothing_that_counts() -> None:
    nudged = Gait(coefficients=MIDDLE.coefficients + np.radians(1e-6))
    walk, other = simulate(Candidate(gait=MIDDLE)), simulate(Candidate(gait=nudged))
    assert other.forward == pytest.approx(walk.forward, abs=1e-3)


# --- Friction -------------------------------------------------------------------------------------


def slide(link: str, pull: float, seconds: float = 0.5) -> tuple[float, float]:
    """Distance [m] and speed [m/s] of a block with a link's sole, pulled by `pull` x its weight."""
    robot = build_robot(PlantConfig())
    inspector = robot.scene_graph.model_inspector()
    body = robot.plant.GetBodyByName(link)
    geometry = robot.plant.GetCollisionGeometriesForBody(body)[0]
    properties = ProximityProperties(inspector.GetProximityProperties(geometry))

    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic_with_fallback")
    plant, _ = AddMultibodyPlant(config, builder)
    plant.set_name("plant")
    size = np.array([0.1, 0.1, 0.01])
    block = plant.AddRigidBody("block", SpatialInertia.SolidBoxWithMass(0.5, *size))
    plant.RegisterCollisionGeometry(block, RigidTransform(), Box(*size), "block", properties)
    add_ground(plant)
    plant.Finalize()
    diagram = builder.Build()
    simulator = start(diagram, diagram.CreateDefaultContext(), PRECISE)
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetFreeBodyPose(context, block, RigidTransform(np.array([0.0, 0.0, size[2] / 2.0])))
    port = plant.get_applied_generalized_force_input_port()
    port.FixValue(context, np.zeros(6))
    simulator.AdvanceTo(0.2)  # Settled.
    place = plant.GetPositions(context)[4]
    port.FixValue(context, np.array([0.0, 0.0, 0.0, pull * 0.5 * 9.81, 0.0, 0.0]))
    simulator.AdvanceTo(0.2 + seconds)
    return float(plant.GetPositions(context)[4] - place), float(plant.GetVelocities(context)[3])


@pytest.mark.parametrize(
    ("link", "static", "kinetic"), [("foot_r", 0.5, 0.417), ("big_toe_l", 0.17, 0.155)]
)
def test_a_block_of_sole_starts_to_slide_at_the_papers_friction(
    link: str, static: float, kinetic: float
) -> None:
    held, _ = slide(link, 0.95 * static)
    assert held < 2e-3
    slid, speed = slide(link, 1.1 * static)
    acceleration = 9.81 * (1.1 * static - kinetic)
    assert speed == pytest.approx(acceleration * 0.5, rel=0.03)
    assert slid == pytest.approx(0.5 * acceleration * 0.5**2, rel=0.05)


# --- Toes -----------------------------------------------------------------------------------------


def floating(foot: FootDesign, moment: float, toe: int) -> tuple[Robot, Simulator, Context]:
    """The robot without weight, off the ground, with a constant moment on one toe."""
    robot = build_robot(PlantConfig(foot=foot, servo=Servo(stiffness=200.0, damping=5.0)))
    robot.plant.gravity_field()
    simulator, context = prepared(robot, foot)
    plant, plant_context = robot.plant, robot.plant.GetMyMutableContextFromRoot(context)
    positions = plant.GetPositions(plant_context)
    positions[6] += 1.0  # z of the torso
    plant.SetPositions(plant_context, positions)
    forces = np.zeros(plant.num_velocities())
    forces[plant.GetJointByName(default_robot().hinges[toe]).velocity_start()] = moment
    plant.get_applied_generalized_force_input_port().FixValue(plant_context, forces)
    return robot, simulator, context


def toe_angles(robot: Robot, simulator: Simulator, toe: int, times: FloatArray) -> FloatArray:
    plant = robot.plant
    context = plant.GetMyContextFromRoot(simulator.get_context())
    index = plant.GetJointByName(default_robot().hinges[toe]).position_start()
    angles = []
    for time in times:
        simulator.AdvanceTo(time)
        angles.append(plant.GetPositions(context)[index])
    return np.array(angles)


@pytest.mark.parametrize(("toe", "stiffness"), [(0, 0.52), (3, 0.26)])  # N·mm/deg
def test_a_toe_bent_twenty_degrees_reads_back_its_stiffness(toe: int, stiffness: float) -> None:
    moment = stiffness * N_MM_PER_DEG * np.radians(20.0)
    robot, simulator, _ = floating(FootDesign(), moment, toe)
    (angle,) = toe_angles(robot, simulator, toe, np.array([0.3]))
    # The robot falls freely: nothing but spring and moment act on the toe.
    assert np.degrees(angle) == pytest.approx(20.0, rel=0.01)


@pytest.mark.parametrize("toe", [0, 1])
def test_a_free_toe_swings_at_the_frequency_of_its_spring(toe: int) -> None:
    foot = FootDesign(toe_damping=1e-5)
    stiffness = (foot.big_toe_stiffness, foot.lesser_toes_stiffness)[toe]
    moment = stiffness * np.radians(15.0)  # Swings between the stops at 0 and 30 degrees.
    robot, simulator, _ = floating(foot, moment, toe)
    times = np.arange(0.0005, 0.12, 0.0005)
    angles = toe_angles(robot, simulator, toe, times) - np.radians(15.0)
    rises = times[1:][(angles[:-1] < 0.0) & (angles[1:] >= 0.0)]
    measured = 2.0 * np.pi / np.diff(rises).mean()
    body = robot.plant.GetBodyByName(default_robot().hinges[toe].replace("_hinge", ""))
    inertia = body.CalcSpatialInertiaInBodyFrame(robot.plant.CreateDefaultContext())
    about_hinge = inertia.CopyToFullMatrix6()[1, 1]
    assert measured == pytest.approx(np.sqrt(stiffness / about_hinge), rel=0.05)


# --- Servos and energy ----------------------------------------------------------------------------


def prepared(
    robot: Robot, foot: FootDesign | None = None, integrator: Integrator = PRECISE
) -> tuple[Simulator, Context]:
    """A precise simulation of a robot that is told to stand."""
    context = robot.diagram.CreateDefaultContext()
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot or FootDesign())
    robot.gait.set_commands(robot.gait.GetMyMutableContextFromRoot(context), STANDING_STILL)
    return start(robot.diagram, context, integrator), context


def copied(robot: Robot, plant_context: Context) -> Context:
    """A context at the same state, whose caches do not lag behind it."""
    copy = robot.plant.CreateDefaultContext()
    state = robot.plant.GetPositionsAndVelocities(plant_context)
    robot.plant.SetPositionsAndVelocities(copy, state)
    return copy


def mechanical_energy(robot: Robot, plant_context: Context) -> float:
    """Kinetic (rotors included) and potential energy (springs included) [J]."""
    plant, copy = robot.plant, copied(robot, plant_context)
    return float(plant.EvalKineticEnergy(copy) + plant.EvalPotentialEnergy(copy))


def internal_energy(robot: Robot, plant_context: Context) -> float:
    """Mechanical energy but for that of the centre of mass, which falls freely [J]."""
    plant, copy = robot.plant, copied(robot, plant_context)
    mass = plant.CalcTotalMass(copy)
    height = plant.CalcCenterOfMassPositionInWorld(copy)[2]
    velocity = plant.CalcCenterOfMassTranslationalVelocityInWorld(copy)
    falling = mass * (9.81 * height + 0.5 * float(velocity @ velocity))
    return mechanical_energy(robot, plant_context) - falling


def test_the_work_of_the_servos_is_the_energy_that_a_free_robot_gains() -> None:
    robot = build_robot(PlantConfig())
    commands = STANDING_STILL.copy()
    swing = np.radians(20.0) * (1.0 - np.cos(np.arange(FRAMES + 1) * 0.02 * 2.0 * np.pi)) / 2.0
    commands[:, JOINTS.index("hip_pitch_r")] = swing
    commands[:, JOINTS.index("knee_l")] = swing
    simulator, context = prepared(robot, integrator=Integrator(step=5e-4))
    plant, plant_context = robot.plant, robot.plant.GetMyMutableContextFromRoot(context)
    positions = plant.GetPositions(plant_context)
    positions[6] += 10.0  # Free fall: neither contact nor a fall of the toes on their stops.
    plant.SetPositions(plant_context, positions)
    gait_context = robot.gait.GetMyMutableContextFromRoot(context)
    robot.gait.set_commands(gait_context, commands, lead=5e-4)
    observer = Observer(robot, commands)
    simulator.set_monitor(observer.monitor)
    before = internal_energy(robot, plant_context)
    simulator.AdvanceTo(0.3)
    observer.record(context)
    gained = internal_energy(robot, plant_context) - before
    measured = observer.measures(observer.history(), forward=1.0)
    net = 2.0 * measured.positive_energy - measured.energy
    assert net > 0.001
    assert gained == pytest.approx(net, rel=0.03)


def test_torque_times_speed_sums_to_the_energy_that_is_reported(reference: Walk) -> None:
    walk = reference
    assert walk.history is not None
    assert walk.measures is not None
    power = walk.history.torques * walk.history.speeds
    by_frames = np.trapezoid(np.maximum(power, 0.0), walk.history.time, axis=0).sum()
    # Frames miss what happens between them; steps do not.
    assert walk.measures.positive_energy == pytest.approx(by_frames, rel=0.15)
    weight_times_way = WEIGHT * walk.forward
    assert walk.measures.cost_of_transport == pytest.approx(
        walk.measures.positive_energy / weight_times_way
    )
    assert walk.measures.energy >= walk.measures.positive_energy > 0.0


def test_a_servo_driven_at_full_torque_stops_accelerating_at_its_no_load_speed() -> None:
    servo = Servo()
    robot = build_robot(PlantConfig(servo=servo))
    simulator, context = prepared(robot)
    plant, plant_context = robot.plant, robot.plant.GetMyMutableContextFromRoot(context)
    positions = plant.GetPositions(plant_context)
    positions[6] += 10.0
    plant.SetPositions(plant_context, positions)
    commands = STANDING_STILL.copy()
    commands[:, JOINTS.index("ankle_roll_r")] = 3.0  # Far away: the controller saturates.
    robot.gait.set_commands(robot.gait.GetMyMutableContextFromRoot(context), commands)
    joint = plant.GetJointByName("ankle_roll_r")
    speeds = []
    for time in np.arange(0.01, 0.25, 0.01):
        simulator.AdvanceTo(time)
        speeds.append(joint.get_angular_rate(plant_context))
    # The rest of the robot turns the other way, but relative speed cannot pass the motor's.
    assert max(speeds) == pytest.approx(servo.no_load_speed, rel=0.03)
    assert max(speeds) < servo.no_load_speed * 1.001


def test_torques_never_exceed_the_torque_speed_line() -> None:
    history = simulate(Candidate(gait=MIDDLE), history=True).history
    assert history is not None
    back_emf = 1.373 / Servo().no_load_speed * history.speeds
    assert (np.abs(history.torques + back_emf) <= 1.373 * (1.0 + 1e-9)).all()


# --- Measures -------------------------------------------------------------------------------------


TWO_MAXIMA = (1.0, 9.0, 14.0, 9.0, 6.0, 8.0, 12.0, 16.0, 7.0)
ONE_MAXIMUM = (2.0, 6.0, 10.0, 8.0, 3.0)
NEVER_DOWN = (5.0,) * 226


def heights(*swings: tuple[int, Sequence[float]], frames: int = 241) -> FloatArray:
    """A foot's lowest point [m]: on the ground but for swings, each a frame and heights [mm]."""
    height = np.full(frames, -0.2)
    for begin, swing in swings:
        height[begin : begin + len(swing)] = swing[: frames - begin]
    return 1e-3 * height


@pytest.mark.parametrize(
    ("swings", "expected"),
    [
        ([(40, TWO_MAXIMA)], 6.0),
        ([(40, ONE_MAXIMUM)], 10.0),
        ([(40, (3.0, 7.0, 7.0, 7.0, 2.0))], 7.0),  # a plateau is one maximum
        ([(40, ONE_MAXIMUM), (80, TWO_MAXIMA), (120, ONE_MAXIMUM)], 6.0),
        ([(40, (1.0, 0.9, 5.0, 9.0, 4.0, 4.2, 1.0))], 9.0),  # ripples are no maxima
        ([(40, (2.0, 8.0, 3.0, 5.0, 2.5, 9.0, 1.0))], 2.5),  # the lowest of several minima
    ],
)
def test_clearance_is_the_lowest_local_minimum_in_mid_swing(
    swings: list[tuple[int, Sequence[float]]], expected: float
) -> None:
    assert swing_clearance(heights(*swings)) == pytest.approx(1e-3 * expected)


@pytest.mark.parametrize(
    "swings",
    [
        [(2, (0.5, 0.1, 0.4, 0.2, 0.5))],  # the unloading before the first step
        [(13, (1.0, 2.0, 4.0, 3.0, 2.0))],  # from before 0.3 s
        [(60, (0.1, 0.2, 0.1, 0.25, 0.1, 0.1))],  # a ripple while it stands
        [(60, (1.0, 2.0, 1.0))],  # a bounce
        [(162, (1.0, 6.0, 8.0, 9.0, 4.0))],  # the step that ends the walk
        [(200, (1.0, 3.0, 2.0, 1.0))],  # after it
    ],
)
def test_what_is_no_swing_of_the_walking_phase_changes_no_clearance(
    swings: list[tuple[int, Sequence[float]]],
) -> None:
    assert swing_clearance(heights(*swings)) == 0.0
    assert swing_clearance(heights(*swings, (100, ONE_MAXIMUM))) == pytest.approx(0.010)


@pytest.mark.parametrize(
    "height",
    [
        heights(),  # stands
        np.zeros(241),  # drags its toe
        heights((15, NEVER_DOWN)),
        heights((40, ONE_MAXIMUM), frames=43),  # it fell in its first swing
        heights(frames=1),
    ],
)
def test_a_foot_without_a_whole_swing_has_no_clearance(height: FloatArray) -> None:
    assert swing_clearance(height) == 0.0


def test_a_toe_that_brushes_the_ground_ends_a_swing() -> None:
    brushing = (4.0, 9.0, 6.0, 2.0, -0.3, -0.3, 3.0, 5.0, 7.0, 1.0)
    assert swing_clearance(heights((40, brushing))) == pytest.approx(0.007)


def test_both_feet_clear_the_ground_in_a_hop_by_the_same_height() -> None:
    left, right = (heights((begin, ONE_MAXIMUM)) for begin in (50, 52))
    assert swing_clearance(left) == swing_clearance(right) == pytest.approx(0.010)


@pytest.mark.parametrize("rigid", [False, True])
def test_feet_of_a_walk_clear_the_ground_by_less_than_they_rise(rigid: bool) -> None:
    foot = FootDesign(rigid_toes=rigid)
    walk = simulate(Candidate(gait=MIDDLE, foot=foot), history=True)
    assert walk.history is not None
    assert walk.measures is not None
    highest = walk.history.sole_height[15:166].max(axis=0)
    assert (np.array(walk.measures.clearance) <= highest).all()
    assert max(walk.measures.clearance) > 0.001


def test_a_standing_robot_neither_slips_nor_swings() -> None:
    measures = follow(STANDING_STILL, history=True).measures
    assert measures is not None
    assert max(measures.slip) < 1e-3
    assert measures.clearance == (0.0, 0.0)
    assert measures.duty_factor == (1.0, 1.0)
    assert measures.peak_ground_reaction == pytest.approx(1.0, abs=0.02)
    assert measures.cost_of_transport > 0.0
