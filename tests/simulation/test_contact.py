"""Laws of the soles: what edges and plates carry, how they slide, and that all soles agree."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    PrismaticJoint,
    RevoluteJoint,
    RevoluteSpring,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from strides import MIDDLE

from drake_gait import Candidate, FootDesign, Gait, WalkSettings, simulate
from drake_gait.errors import SettingsError
from drake_gait.gait import FRAMES, JOINTS, FloatArray, Start
from drake_gait.robot.description import model_path
from drake_gait.robot.robot_file import default_robot
from drake_gait.simulation.contact import Plate, add_ground, add_soles, plates, sole_mesh
from drake_gait.simulation.plant import build_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.simulate import follow, start
from drake_gait.sole import Contact, Sole
from drake_gait.walk import Fidelity, Integrator

STANDING_STILL = np.zeros((FRAMES + 1, len(JOINTS)))
NEW = [Sole.AREA, Sole.POINTS]

LENGTH, WIDTH, RIM = 0.095, 0.078, Contact().rim
MASS, INERTIA, GRAVITY = 1.6, 0.02, 9.81
SURFACE = 0.26342  # so that plate and ground together have
FRICTION = 2.0 * SURFACE / (1.0 + SURFACE)


def mirrored(commands: FloatArray) -> FloatArray:
    """The commands of the robot in a mirror: legs exchanged, roll to the other side."""
    other_side = {"r": "l", "l": "r"}
    twins = [JOINTS.index(name[:-1] + other_side[name[-1]]) for name in JOINTS]
    signs = [-1.0 if "roll" in name else 1.0 for name in JOINTS]
    return np.array(commands[:, twins] * signs)


# --- One plate on the ground ----------------------------------------------------------------------


def plate_on_ground(
    sole: Sole, about: tuple[float, float], tilt: tuple[float, float], *, axis: str
) -> tuple[MultibodyPlant, Simulator, Context]:
    """A loaded heel plate, settled, that may sink and move along or about one axis.

    Args:
        sole: What is under it.
        about: The point of the plate that the axis goes through [m].
        tilt: Its roll and pitch [deg].
        axis: "turn" about z, or "slide" along x.
    """
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic_with_fallback")
    plant, _ = AddMultibodyPlant(config, builder)
    plant.set_name("plant")
    light = SpatialInertia(1e-6, np.zeros(3), UnitInertia.SolidSphere(0.01))
    slider = plant.AddRigidBody("slider", light)
    radius = np.sqrt(INERTIA / MASS / 0.4)
    heavy = SpatialInertia(MASS, np.zeros(3), UnitInertia.SolidSphere(radius))
    foot = plant.AddRigidBody("foot_l", heavy)
    up = np.array([0.0, 0.0, 1.0])
    plant.AddJoint(PrismaticJoint("sink", plant.world_frame(), slider.body_frame(), up))
    turned = RigidTransform(RollPitchYaw(*np.radians(tilt), 0.0), np.zeros(3)).inverse()
    frame = plant.AddFrame(FixedOffsetFrame("upright", foot.body_frame(), turned))
    if axis == "turn":
        plant.AddJoint(RevoluteJoint("free", slider.body_frame(), frame, up))
    else:
        ahead = np.array([1.0, 0.0, 0.0])
        plant.AddJoint(PrismaticJoint("free", slider.body_frame(), frame, ahead))
    plate = Plate(
        link="foot_l",
        is_left=True,
        is_toe=False,
        X_LP=RigidTransform(np.array([-about[0], -about[1], 0.0])),
        length=LENGTH,
        width=WIDTH,
        friction=CoulombFriction(SURFACE, SURFACE),
    )
    add_soles(plant, [plate], sole)
    add_ground(plant, sole)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.GetJointByName("sink").set_translation(plant_context, -1.234e-4)
    simulator = start(diagram, context, Integrator(step=0.001))
    simulator.AdvanceTo(0.4)
    return plant, simulator, plant_context


def retarded(
    sole: Sole,
    about: tuple[float, float],
    tilt: tuple[float, float],
    *,
    axis: str,
    speed: float,
    seconds: float = 0.02,
) -> float:
    """Acceleration against a motion that begins at a speed [m/s² or rad/s²], and its mean speed."""
    plant, simulator, context = plate_on_ground(sole, about, tilt, axis=axis)
    velocities = plant.GetVelocities(context)
    velocities[plant.GetJointByName("free").velocity_start()] = speed
    plant.SetVelocities(context, velocities)
    simulator.Initialize()
    index = plant.GetJointByName("free").velocity_start()
    begin = simulator.get_context().get_time()
    simulator.AdvanceTo(begin + 0.004)
    before = plant.GetVelocities(context)[index]
    simulator.AdvanceTo(begin + 0.004 + seconds)
    return float((before - plant.GetVelocities(context)[index]) / seconds)


def mean_distance(*, rim: float) -> float:
    """Mean distance of a rim of the plate from the plate's middle [m]."""
    x, y = np.meshgrid(
        (np.arange(800) + 0.5) / 800 * LENGTH - LENGTH / 2.0,
        (np.arange(800) + 0.5) / 800 * WIDTH - WIDTH / 2.0,
    )
    on_rim = (np.abs(x) > LENGTH / 2.0 - rim) | (np.abs(y) > WIDTH / 2.0 - rim)
    return float(np.hypot(x, y)[on_rim].mean())


FLAT = ((0.0, 0.0), (0.0, 0.0))
FRONT = ((LENGTH / 2.0, 0.0), (0.0, 8.0))
BACK = ((-LENGTH / 2.0, 0.0), (0.0, -8.0))
SIDE = ((0.0, WIDTH / 2.0), (-8.0, 0.0))


def corner_statics(tilt: tuple[float, float]) -> tuple[tuple[float, float], float]:
    """The middle of the pressure under a corner [m], and its mean distance from there [m].

    The ground is a layer of springs, and the plate sinks until they bear it.

    Args:
        tilt: Roll and pitch of the plate [deg]; both decide which corner is the lowest.
    """
    contact, cells = Contact(), 800
    x, y = np.meshgrid(
        ((np.arange(cells) + 0.5) / cells - 0.5) * LENGTH,
        ((np.arange(cells) + 0.5) / cells - 0.5) * WIDTH,
    )
    on_rim = (np.abs(x) > LENGTH / 2.0 - RIM) | (np.abs(y) > WIDTH / 2.0 - RIM)
    (a, b, _), (c, d, _), (e, f, upright) = (
        RollPitchYaw(*np.radians(tilt), 0.0).ToRotationMatrix().matrix()
    )
    height = e * x + f * y
    area = LENGTH * WIDTH * upright / cells**2

    def forces(sunk: float) -> FloatArray:
        depth: FloatArray = np.maximum(height.min() + sunk - height, 0.0) * on_rim
        return contact.modulus / contact.slab * depth * area

    low, high = 0.0, 0.01
    for _ in range(40):
        sunk = (low + high) / 2.0
        low, high = (low, sunk) if forces(sunk).sum() > MASS * GRAVITY else (sunk, high)
    share = forces(high) / forces(high).sum()
    middle = float((share * x).sum()), float((share * y).sum())
    dx, dy = x - middle[0], y - middle[1]
    return middle, float((share * np.hypot(a * dx + b * dy, c * dx + d * dy)).sum())


def centre_of_load(tilt: tuple[float, float]) -> tuple[float, float]:
    """The centre of the load under a plate on a rim, in the plate [m]; it turns about it freely."""
    plant, _, context = plate_on_ground(Sole.AREA, (0.0, 0.0), tilt, axis="turn")
    results = plant.get_contact_results_output_port().Eval(context)
    patch = results.hydroelastic_contact_info(0)
    force, torque = patch.F_Ac_W().translational(), patch.F_Ac_W().rotational()
    arm = np.cross(force, torque) / (force @ force)  # Of the force's line from the centroid.
    p_WC = patch.contact_surface().centroid() + arm
    X_WF = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("foot_l"))
    x, y, _ = X_WF.inverse() @ p_WC
    return float(x), float(y)


CORNERS = {
    f"{along} {across}": (across_sign * 5.0, along_sign * 5.0)
    for along, along_sign in (("front", 1.0), ("back", -1.0))
    for across, across_sign in (("left", -1.0), ("right", 1.0))
}
"""Roll and pitch that put the plate on each of its corners [deg]."""


@pytest.mark.parametrize(
    ("sole", "stance", "arm"),
    [
        (Sole.AREA, FLAT, mean_distance(rim=RIM)),
        (Sole.AREA, FRONT, WIDTH / 4.0),  # a line's resistance: a quarter of its length
        (Sole.AREA, BACK, WIDTH / 4.0),
        (Sole.AREA, SIDE, LENGTH / 4.0),
        (Sole.POINTS, FLAT, np.hypot(LENGTH, WIDTH) / 2.0),
        (Sole.POINTS, FRONT, WIDTH / 2.0),  # two points at the ends of the edge
        (Sole.POINTS, SIDE, LENGTH / 2.0),
    ],
)
def test_a_plate_resists_turning_as_statics_says(
    sole: Sole, stance: tuple[tuple[float, float], tuple[float, float]], arm: float
) -> None:
    torque = INERTIA * retarded(sole, *stance, axis="turn", speed=3.0)
    assert torque == pytest.approx(FRICTION * MASS * GRAVITY * arm, rel=0.1)


@pytest.mark.parametrize("tilt", CORNERS.values(), ids=CORNERS)
def test_a_corner_of_a_rim_resists_turning_with_its_own_extent(tilt: tuple[float, float]) -> None:
    middle, extent = corner_statics(tilt)
    centre = centre_of_load(tilt)
    torque = INERTIA * retarded(Sole.AREA, centre, tilt, axis="turn", speed=3.0)
    assert torque == pytest.approx(FRICTION * MASS * GRAVITY * extent, rel=0.1)
    # Forces of few faces act at their centroids, and those lie further inside than the pressure.
    assert np.hypot(*np.subtract(centre, middle)) < 0.0025
    assert np.hypot(*centre) < np.hypot(*middle)


@pytest.mark.parametrize("tilt", CORNERS.values(), ids=CORNERS)
def test_a_point_does_not_resist_turning(tilt: tuple[float, float]) -> None:
    corner = np.sign(tilt[1]) * LENGTH / 2.0, -np.sign(tilt[0]) * WIDTH / 2.0
    torque = INERTIA * retarded(Sole.POINTS, corner, tilt, axis="turn", speed=3.0)
    assert abs(torque) < 1e-4 * FRICTION * MASS * GRAVITY


@pytest.mark.parametrize("sole", NEW)
@pytest.mark.parametrize("stance", [FLAT, SIDE], ids=["flat", "side edge"])
def test_a_sliding_plate_loses_what_friction_takes(
    sole: Sole, stance: tuple[tuple[float, float], tuple[float, float]]
) -> None:
    deceleration = retarded(sole, *stance, axis="slide", speed=0.5)
    assert deceleration == pytest.approx(FRICTION * GRAVITY, rel=0.02)


# --- A plate that rolls over its edge -------------------------------------------------------------

TALL, GYRATION = 0.15, 0.05
"""Height of the centre of mass over the plate, and radius of gyration about it [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rocking:
    """A plate under a tall load, at rest on its rear edge before it falls on its front one."""

    plant: MultibodyPlant
    simulator: Simulator
    context: Context
    reading: Context
    """Of the plant, to read from: the caches of the simulated one lag behind its state."""

    @property
    def foot(self) -> RigidBody:
        """The plate with its load."""
        return self.plant.GetBodyByName("foot_l")

    @property
    def energy(self) -> float:
        """Kinetic and potential energy over that of the plate flat and at rest [J]."""
        flat = MASS * GRAVITY * TALL
        kinetic = self.plant.CalcKineticEnergy(self.context)
        return float(kinetic + self.plant.CalcPotentialEnergy(self.context) - flat)

    @property
    def pitch(self) -> float:
        """Angle about y, the nose down [rad]."""
        X_WF = self.plant.EvalBodyPoseInWorld(self.reading, self.foot)
        return RollPitchYaw(X_WF.rotation()).pitch_angle()

    @property
    def turning(self) -> float:
        """Angular velocity about y, the nose going down [rad/s]."""
        return float(self.plant.GetVelocities(self.context)[1])

    def advance(self, time: float) -> None:
        """Simulate until a time [s]."""
        self.simulator.AdvanceTo(time)
        state = self.plant.GetPositionsAndVelocities(self.context)
        self.plant.SetPositionsAndVelocities(self.reading, state)


def rocking(sole: Sole, part: float, step: float) -> Rocking:
    """Put the plate on its rear edge, tilted by a part of the angle at which it would topple."""
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic_with_fallback")
    plant, _ = AddMultibodyPlant(config, builder)
    plant.set_name("plant")
    ball = UnitInertia.SolidSphere(GYRATION / np.sqrt(0.4))
    up = np.array([0.0, 0.0, TALL])
    inertia = SpatialInertia(MASS, up, ball.ShiftFromCenterOfMass(-up))
    foot = plant.AddRigidBody("foot_l", inertia)
    plate = Plate(
        link="foot_l",
        is_left=True,
        is_toe=False,
        X_LP=RigidTransform(),
        length=LENGTH,
        width=WIDTH,
        friction=CoulombFriction(SURFACE, SURFACE),
    )
    add_soles(plant, [plate], sole)
    add_ground(plant, sole)
    plant.Finalize()
    diagram = builder.Build()
    context, copy = diagram.CreateDefaultContext(), diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    tilt = part * np.arctan2(LENGTH / 2.0, TALL)
    high = np.array([0.0, 0.0, LENGTH / 2.0 * np.sin(tilt)])
    plant.SetFreeBodyPose(own, foot, RigidTransform(RollPitchYaw(0.0, -tilt, 0.0), high))
    return Rocking(
        plant=plant,
        simulator=start(diagram, context, Integrator(step=step)),
        context=own,
        reading=plant.GetMyMutableContextFromRoot(copy),
    )


def lost_in_rolling(sole: Sole, part: float, step: float) -> float:
    """Part of the energy that is lost from rest on the rear edge to rest on the front one."""
    plate = rocking(sole, part, step)
    before, time = plate.energy, 0.0
    plate.advance(step)
    while plate.pitch < np.radians(0.5) or plate.turning > 0.0:
        time += step
        plate.advance(time + step)
        assert time < 2.0
    return float((before - plate.energy) / before)


@pytest.mark.parametrize("step", [0.001, 0.0025])
@pytest.mark.parametrize("part", [0.5, 0.7, 0.9])
def test_a_plate_that_rolls_over_its_edge_loses_what_an_inelastic_impact_takes(
    part: float, step: float
) -> None:
    # Conservation of angular momentum about the edge that lands (Housner 1963).
    k, a = GYRATION**2 + TALL**2, (LENGTH / 2.0) ** 2
    expected = 1.0 - ((k - a) / (k + a)) ** 2
    assert lost_in_rolling(Sole.AREA, part, step) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("sole", NEW)
def test_a_plate_rolls_over_its_edge_alike_in_fine_steps(sole: Sole) -> None:
    coarse, fine = (lost_in_rolling(sole, 0.7, step) for step in (0.001, 0.0002))
    assert coarse == pytest.approx(fine, rel=0.1)


@pytest.mark.parametrize("sole", NEW)
def test_a_plate_that_rolls_over_its_edge_loses_what_damping_and_friction_take(sole: Sole) -> None:
    plate, step, end = rocking(sole, 0.7, 0.0002), 0.0002, 0.5
    before, work, stored = plate.energy, 0.0, 0.0
    for index in range(round(end / step)):
        plate.advance((index + 1) * step)
        stored, power = stored_and_lost(plate, sole)
        work += power * step
    # It begins without being sunk in: at the end, a little is stored in the ground.
    assert before - plate.energy == pytest.approx(work + stored, rel=0.1)


def stored_and_lost(plate: Rocking, sole: Sole) -> tuple[float, float]:
    """Energy in the springs of the ground [J], and power of its dampers and of friction [W].

    A spring with force f at rest has f (1 + d v), where the plate comes nearer at speed v.
    """
    contact, foot = Contact(), plate.foot
    X_WF = plate.plant.EvalBodyPoseInWorld(plate.reading, foot)
    velocity = plate.plant.EvalBodySpatialVelocityInWorld(plate.reading, foot)
    springs: list[tuple[FloatArray, FloatArray, float, float]] = []
    up = np.array([0.0, 0.0, 1.0])
    if sole is Sole.POINTS:
        for corner in ((-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)):
            radius = 5e-4
            place = X_WF @ np.array([corner[0] * LENGTH / 2.0, corner[1] * WIDTH / 2.0, radius])
            force = contact.stiffness * max(radius - place[2], 0.0)
            springs.append((place - radius * up, up, force, force**2 / contact.stiffness / 2.0))
    else:
        results = plate.plant.get_contact_results_output_port().Eval(plate.reading)
        for index in range(results.num_hydroelastic_contacts()):
            surface = results.hydroelastic_contact_info(index).contact_surface()
            mesh, pressures = surface.poly_mesh_W(), surface.poly_e_MN()
            for face in range(mesh.num_elements()):
                place, normal = mesh.element_centroid(face), mesh.face_normal(face)
                pressure, area = pressures.EvaluateCartesian(face, place), mesh.area(face)
                sunk = pressure * contact.slab / contact.modulus
                springs.append(
                    (
                        place,
                        normal * np.sign(normal[2]),
                        area * pressure,
                        area * pressure * sunk / 2,
                    )
                )
    stored, power = 0.0, 0.0
    for place, normal, force, energy in springs:
        v = velocity.Shift(place - X_WF.translation()).translational()
        approach = -float(v @ normal)
        whole = force * max(0.0, 1.0 + contact.dissipation * approach)
        along = float(np.linalg.norm(v + approach * normal))
        stored += energy
        power += (whole - force) * approach + FRICTION * whole * along
    return stored, power


# --- An edge under a load beside its middle -------------------------------------------------------


@pytest.mark.parametrize("sole", NEW)
@pytest.mark.parametrize("pitch", [8.0, -8.0], ids=["front edge", "back edge"])
@pytest.mark.parametrize(("part", "stands"), [(0.8, True), (1.2, False)])
def test_an_edge_carries_a_load_beside_its_middle_and_none_beside_its_end(
    sole: Sole, pitch: float, part: float, stands: bool
) -> None:
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic_with_fallback")
    plant, _ = AddMultibodyPlant(config, builder)
    plant.set_name("plant")
    slider = plant.AddRigidBody(
        "slider", SpatialInertia(1e-6, np.zeros(3), UnitInertia.SolidSphere(0.01))
    )
    beside = np.array([0.0, part * WIDTH / 2.0, 0.0])
    ball = UnitInertia.SolidSphere(GYRATION).ShiftFromCenterOfMass(-beside)
    foot = plant.AddRigidBody("foot_l", SpatialInertia(MASS, beside, ball))
    up, ahead = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    plant.AddJoint(PrismaticJoint("sink", plant.world_frame(), slider.body_frame(), up))
    tilted = RigidTransform(RollPitchYaw(0.0, np.radians(pitch), 0.0), np.zeros(3))
    frame = plant.AddFrame(FixedOffsetFrame("upright", foot.body_frame(), tilted.inverse()))
    roll = plant.AddJoint(RevoluteJoint("roll", slider.body_frame(), frame, ahead))
    plate = Plate(
        link="foot_l",
        is_left=True,
        is_toe=False,
        X_LP=RigidTransform(np.array([-np.sign(pitch) * LENGTH / 2.0, 0.0, 0.0])),
        length=LENGTH,
        width=WIDTH,
        friction=CoulombFriction(SURFACE, SURFACE),
    )
    add_soles(plant, [plate], sole)
    add_ground(plant, sole)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.GetJointByName("sink").set_translation(
        plant.GetMyMutableContextFromRoot(context), -1.234e-4
    )
    start(diagram, context, Integrator(step=0.001)).AdvanceTo(0.8)
    leans = abs(roll.get_angle(plant.GetMyContextFromRoot(context)))
    assert bool(leans < np.radians(10.0)) is stands


# --- The mesh -------------------------------------------------------------------------------------


def triangles(text: str) -> FloatArray:
    """Corners of a mesh's faces, shape (n, 3, 3)."""
    rows = [line.split() for line in text.splitlines()]
    vertices = np.array([row[1:] for row in rows if row[0] == "v"], dtype=float)
    return vertices[np.array([row[1:] for row in rows if row[0] == "f"], dtype=int) - 1]


@pytest.mark.parametrize("left", [True, False])
@pytest.mark.parametrize(("hinge", "edges"), [(False, 4), (True, 3)])
@pytest.mark.parametrize("pieces", [1, 2, 5])
def test_a_rim_covers_the_edges_of_its_plate_once_and_faces_down(
    left: bool, hinge: bool, edges: int, pieces: int
) -> None:
    text = sole_mesh(0.06, 0.04, rim=0.005, along=(pieces, pieces), hinge=hinge, left=left)
    corners = triangles(text)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(corners) == 2 * pieces * edges
    assert (normals[:, 2] < 0.0).all()
    hollow = (0.055 if hinge else 0.05) * 0.03
    assert -normals[:, 2].sum() / 2.0 == pytest.approx(0.06 * 0.04 - hollow)


def test_a_rim_is_never_wider_than_a_third_of_its_plate() -> None:
    corners = triangles(sole_mesh(0.06, 0.009, rim=0.006))
    assert np.unique(np.abs(corners[:, :, 1]).round(9)).tolist() == [0.0, 0.0015, 0.0045]


# --- The robot's soles ----------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["khr3hv.sdf", "khr3hv_cad.sdf"])
@pytest.mark.parametrize(
    "foot", [FootDesign(), FootDesign(big_toe_width=0.031, toe_length=0.017)], ids=["paper", "own"]
)
def test_soles_lie_under_their_plates_in_the_size_of_the_design(
    model: str, foot: FootDesign
) -> None:
    robot = build_robot(PlantConfig(model=model, foot=foot))
    found = plates(robot.plant, robot.scene_graph, default_robot())
    context = robot.plant.CreateDefaultContext()
    for plate in found:
        X_WL = robot.plant.EvalBodyPoseInWorld(context, robot.plant.GetBodyByName(plate.link))
        X_WP = X_WL @ plate.X_LP
        assert X_WP.rotation().IsNearlyIdentity(1e-9)
        assert X_WP.translation()[2] == pytest.approx(0.0, abs=1e-6)
    sizes = {plate.link: (plate.length, plate.width) for plate in found}
    assert sizes["big_toe_r"] == pytest.approx((foot.toe_length, foot.big_toe_width))
    assert sizes["lesser_toes_l"] == pytest.approx((foot.toe_length, 0.077 - foot.big_toe_width))


@pytest.mark.parametrize(
    ("angles", "size"),
    [
        ("0 0 0", "0.095 0.078 0.005"),
        ("0 1.570796326794897 0", "0.005 0.078 0.095"),
        ("1.570796326794897 0 0", "0.095 0.005 0.078"),
        ("0 0 1.570796326794897", "0.078 0.095 0.005"),
        ("3.141592653589793 0 3.141592653589793", "0.095 0.078 0.005"),
    ],
)
def test_a_box_gives_the_same_sole_on_whichever_side_it_is_written(
    angles: str, size: str, tmp_path: Path
) -> None:
    old = "0.095 0.078 0.005"
    text = model_path().read_text(encoding="utf-8")
    begin = text.index('<collision name="heel_collision">')
    end = text.index("</collision>", begin)
    part = re.sub(r"(<pose>\S+ \S+ \S+)[^<]*", rf"\g<1> {angles}", text[begin:end], count=1)
    assert old in part
    path = tmp_path / "turned.sdf"
    path.write_text(text[:begin] + part.replace(old, size) + text[end:], encoding="utf-8")
    usual, turned = (
        plates(robot.plant, robot.scene_graph, default_robot())
        for robot in (
            build_robot(PlantConfig(model=model, foot=None)) for model in ("khr3hv.sdf", path)
        )
    )
    for plate, other in zip(usual, turned, strict=True):
        assert (other.link, other.length, other.width) == (plate.link, plate.length, plate.width)
        assert other.X_LP.IsNearlyEqualTo(plate.X_LP, 1e-9)


def test_the_friction_of_the_walk_scales_that_of_every_sole() -> None:
    def pairs(factor: float) -> FloatArray:
        robot = build_robot(PlantConfig(friction=factor))
        found = [
            plate.friction for plate in plates(robot.plant, robot.scene_graph, default_robot())
        ]
        alone = np.array([(one.static_friction(), one.dynamic_friction()) for one in found])
        return 2.0 * alone / (1.0 + alone)

    assert pairs(0.8) == pytest.approx(0.8 * pairs(1.0))


@pytest.mark.parametrize("sole", NEW)
def test_other_ground_is_another_walk(sole: Sole) -> None:
    settings = WalkSettings(sole=sole)
    walk, slippery = (
        simulate(Candidate(gait=MIDDLE), replace(settings, friction=factor))
        for factor in (1.0, 0.7)
    )
    assert abs(slippery.forward - walk.forward) > 1e-3


@pytest.mark.parametrize("sole", list(Sole))
def test_a_standing_foot_bears_half_of_the_weight_without_chatter(sole: Sole) -> None:
    walk = follow(STANDING_STILL, settings=WalkSettings(sole=sole), history=True)
    assert walk.history is not None
    assert walk.measures is not None
    loads = walk.history.ground_reaction[50:, :, 2]
    assert loads.mean(axis=0) == pytest.approx(np.full(2, 1.5 * GRAVITY / 2.0), rel=0.01)
    assert (loads.std(axis=0) < 0.02 * loads.mean(axis=0)).all()
    assert walk.measures.duty_factor == (1.0, 1.0)
    assert max(walk.measures.slip) < 1e-3
    assert walk.measures.clearance == (0.0, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("foot", [FootDesign(), FootDesign(rigid_toes=True)], ids=["toes", "rigid"])
def test_all_soles_agree_on_a_walk_and_on_its_loads(foot: FootDesign) -> None:
    walks = [
        simulate(
            Candidate(gait=MIDDLE, foot=foot), WalkSettings(sole=sole, step=0.002), history=True
        )
        for sole in Sole
    ]
    assert all(walk.survived for walk in walks)
    forward = [walk.forward for walk in walks]
    assert max(forward) - min(forward) < 0.03
    for walk in walks:
        assert walk.history is not None
        assert walk.measures is not None
        vertical = walk.history.ground_reaction[:, :, 2].sum(axis=1)
        assert vertical.mean() == pytest.approx(1.5 * GRAVITY, rel=0.05)
        assert 0.5 < min(walk.measures.duty_factor) <= max(walk.measures.duty_factor) < 0.9


@pytest.mark.parametrize("sole", NEW)
def test_a_mirrored_gait_walks_a_mirrored_path_to_a_tenth_of_a_millimetre(sole: Sole) -> None:
    commands, settings = MIDDLE.commands_from(Start.RAMP), WalkSettings(sole=sole)
    walk, twin = follow(commands, settings=settings), follow(mirrored(commands), settings=settings)
    assert twin.forward == pytest.approx(walk.forward, abs=1e-4)
    assert twin.lateral == pytest.approx(-walk.lateral, abs=1e-4)
    assert twin.yaw == pytest.approx(-walk.yaw, abs=np.radians(0.1))


@pytest.mark.parametrize("sole", NEW)
@pytest.mark.parametrize("fidelity", list(Fidelity))
def test_a_rounding_error_in_a_coefficient_changes_no_walk(sole: Sole, fidelity: Fidelity) -> None:
    settings = WalkSettings(sole=sole, fidelity=fidelity)
    nudged = MIDDLE.coefficients.copy()
    nudged[1, 0] += 1e-14
    walk, other = (
        simulate(Candidate(gait=gait), settings) for gait in (MIDDLE, Gait(coefficients=nudged))
    )
    assert other.forward == pytest.approx(walk.forward, abs=1e-4)
    assert other.lateral == pytest.approx(walk.lateral, abs=1e-4)
    assert other.yaw == pytest.approx(walk.yaw, abs=np.radians(0.1))


@pytest.mark.parametrize("sole", NEW)
def test_a_search_walks_about_as_at_reference_fidelity(sole: Sole) -> None:
    coarse, fine = (
        simulate(Candidate(gait=MIDDLE), WalkSettings(sole=sole, fidelity=fidelity))
        for fidelity in Fidelity
    )
    assert coarse.forward == pytest.approx(fine.forward, abs=0.015)
    assert coarse.lateral == pytest.approx(fine.lateral, abs=0.015)


# --- Settings -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sole", "fidelity", "expected"),
    [
        (Sole.AREA, Fidelity.SEARCH, Integrator(step=0.004)),
        (Sole.POINTS, Fidelity.REFERENCE, Integrator(step=0.001)),
        (Sole.AREA, Fidelity.REFERENCE, Integrator(step=0.001)),
        (Sole.BOXES, Fidelity.SEARCH, Integrator(step=0.004)),
        (Sole.BOXES, Fidelity.REFERENCE, Integrator(step=0.02, accuracy=1e-4)),
    ],
)
def test_fidelity_and_sole_choose_the_integrator(
    sole: Sole, fidelity: Fidelity, expected: Integrator
) -> None:
    assert WalkSettings(sole=sole, fidelity=fidelity).stepping == expected


@pytest.mark.parametrize(("step", "steps"), [(0.0025, 8), (0.003, 7), (0.02, 1), (0.0033, 7)])
def test_a_frame_has_equal_steps_none_longer_than_asked_for(step: float, steps: int) -> None:
    assert WalkSettings(step=step).stepping.step == pytest.approx(0.02 / steps, abs=1e-15)


# --- A toe ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("sole", NEW)
def test_a_bent_toe_presses_the_ground_with_what_its_spring_gives(sole: Sole) -> None:
    stiffness, length, bent = 0.03, 0.028, np.radians(20.0)
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(time_step=0.0, contact_model="hydroelastic_with_fallback")
    plant, _ = AddMultibodyPlant(config, builder)
    plant.set_name("plant")
    toe = plant.AddRigidBody(
        "big_toe_l", SpatialInertia.SolidBoxWithMass(0.01, length, 0.022, 0.005)
    )
    # The heel part is up by 20 degrees: the spring would bend the toe into the ground as far.
    heel = RigidTransform(RollPitchYaw(0.0, bent, 0.0), np.array([0.0, 0.0, 1e-4]))
    frame = plant.AddFrame(FixedOffsetFrame("heel", plant.world_frame(), heel))
    hinge = plant.AddJoint(
        RevoluteJoint("hinge", frame, toe.body_frame(), np.array([0.0, 1.0, 0.0]), 1e-3)
    )
    plant.AddForceElement(RevoluteSpring(hinge, 0.0, stiffness))
    plant.mutable_gravity_field().set_gravity_vector(np.zeros(3))
    plate = Plate(
        link="big_toe_l",
        is_left=True,
        is_toe=True,
        X_LP=RigidTransform(np.array([length / 2.0, 0.0, 0.0])),
        length=length,
        width=0.022,
        friction=CoulombFriction(SURFACE, SURFACE),
    )
    add_soles(plant, [plate], sole)
    add_ground(plant, sole)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    hinge.set_angle(plant_context, -bent)
    start(diagram, context, Integrator(step=0.001)).AdvanceTo(0.5)
    copy = diagram.CreateDefaultContext()
    at_rest = plant.GetMyMutableContextFromRoot(copy)
    plant.SetPositions(at_rest, plant.GetPositions(plant_context))
    results = plant.get_contact_results_output_port().Eval(at_rest)
    patches = (
        results.hydroelastic_contact_info(index)
        for index in range(results.num_hydroelastic_contacts())
    )
    pairs = (
        results.point_pair_contact_info(index) for index in range(results.num_point_pair_contacts())
    )
    moments = [
        one.contact_surface().centroid()[0] * abs(one.F_Ac_W().translational()[2])
        + one.F_Ac_W().rotational()[1] * np.sign(-one.F_Ac_W().translational()[2])
        for one in patches
    ] + [one.contact_point()[0] * abs(one.contact_force()[2]) for one in pairs]
    angle = hinge.get_angle(plant_context)
    assert angle == pytest.approx(-bent, abs=np.radians(1.0))
    assert sum(moments) == pytest.approx(-stiffness * angle, rel=0.05)


@pytest.mark.parametrize("name", ["sole", "start", "fidelity"])
def test_a_choice_may_be_given_by_its_value_and_by_no_other(name: str) -> None:
    kind = {"sole": Sole, "start": Start, "fidelity": Fidelity}[name]
    for member in kind:
        settings = WalkSettings(**{name: str(member)})
        assert getattr(settings, name) is member
        assert settings == WalkSettings(**{name: member})
    with pytest.raises(SettingsError, match=rf"{name} must be one of .*got 'mud'"):
        WalkSettings(**{name: "mud"})
