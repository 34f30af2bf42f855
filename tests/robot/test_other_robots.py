"""Robots that are no KHR-3HV, in plain Drake: the shipped OP3 and two of our own for tests."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    GeometryId,
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
from pydrake.multibody.tree import PdControllerGains, RevoluteSpring, RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from drake_gait.robot.description import models_folder

DATA = Path(__file__).parents[1] / "data/robots"
MIRROR = np.diag([1.0, -1.0, 1.0])
ROLES = ("hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")


@dataclass(frozen=True, kw_only=True)
class Leg:
    """One leg's joints by role, each with its sign against the KHR-3HV's, and its foot's link."""

    joints: dict[str, tuple[str, int]]
    foot: str
    toe: str | None = None


@dataclass(frozen=True, kw_only=True)
class Other:
    """A robot with its standing pose and its servos."""

    file: Path
    base: str
    legs: dict[str, Leg]
    stance: tuple[float, float, float]
    """Hip pitch, knee and ankle pitch as the KHR-3HV's [deg]."""
    stiffness: float
    """Of the servos [N·m/rad]."""
    damping: float
    """Of the servos with their back-EMF [N·m·s/rad]."""
    toe_spring: float = 0.0
    """Stiffness [N·m/rad]."""


def signs(pattern: str, *values: int) -> dict[str, tuple[str, int]]:
    return {
        role: (name, value)
        for role, name, value in zip(ROLES, pattern.split(), values, strict=True)
        if value
    }


OP3 = Other(
    file=models_folder() / "op3.sdf",
    base="body_link",
    legs={
        side: Leg(
            joints=signs(
                f"{side}_hip_roll {side}_hip_pitch {side}_knee {side}_ank_pitch {side}_ank_roll",
                *values,
            ),
            foot=f"{side}_ank_roll_link",
        )
        for side, values in (("l", (-1, -1, 1, 1, -1)), ("r", (-1, 1, -1, -1, -1)))
    },
    stance=(12.0, 30.0, 18.0),
    # The servos' gain of 1000 that ROBOTIS sets for the legs: 7.8 units of the voltage a step of
    # 0.088 degrees, so that all of its 885 units, the stall torque, come 9.96 degrees off.
    stiffness=23.6,
    damping=0.05 + 4.1 / 4.82,
)
STIFF_HIPS = Other(
    file=DATA / "stiff_hips.urdf",
    base="trunk",
    legs={
        side: Leg(
            joints=signs(
                f"none {side}_hip {side}_knee {side}_ankle {side}_ankle_roll", 0, -1, -1, 1, -1
            ),
            foot=f"{side}_foot",
        )
        for side in ("left", "right")
    },
    stance=(10.0, 20.0, 10.0),
    stiffness=20.0,
    damping=0.5,
)
TOED = Other(
    file=DATA / "toed.xml",
    base="pelvis",
    legs={
        side: Leg(
            joints=signs(
                " ".join(f"{side}_{role}" for role in ROLES),
                *values,
            ),
            foot=f"{side}_foot",
            toe=f"{side}_toe",
        )
        for side, values in (("left", (1, -1, 1, -1, -1)), ("right", (-1, -1, 1, -1, 1)))
    },
    stance=(10.0, 20.0, 10.0),
    stiffness=15.0,
    damping=0.4,
    toe_spring=0.045,
)
ROBOTS = {"op3": OP3, "stiff_hips": STIFF_HIPS, "toed": TOED}


@dataclass(frozen=True, kw_only=True, eq=False)
class Built:
    """A robot on the ground."""

    robot: Other
    diagram: Diagram
    plant: MultibodyPlant
    scene_graph: SceneGraph

    def boxes(self, body: RigidBody) -> Iterator[tuple[GeometryId, RigidTransform, np.ndarray]]:
        """Each box that touches: itself, its pose in the link's frame, its size."""
        inspector = self.scene_graph.model_inspector()
        for geometry in self.plant.GetCollisionGeometriesForBody(body):
            shape = inspector.GetShape(geometry)
            assert isinstance(shape, Box)
            yield geometry, inspector.GetPoseInFrame(geometry), np.array(shape.size())

    def corners(self, context: Context, link: str) -> np.ndarray:
        """Corners of a link's boxes in the world [m], shape (3, 8 n)."""
        unit = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1)
        body = self.plant.GetBodyByName(link)
        pose = self.plant.EvalBodyPoseInWorld(context, body)
        return np.hstack(
            [pose @ (place @ (unit * size[:, None])) for _, place, size in self.boxes(body)]
        )

    def pose(self, context: Context, side: str, angles: dict[str, float]) -> None:
        """Turn a leg's joints by the KHR-3HV's angles [rad]; what the robot lacks is left out."""
        for role, (joint, sign) in self.robot.legs[side].joints.items():
            self.plant.GetJointByName(joint).set_angle(context, sign * angles.get(role, 0.0))

    def stand(self, context: Context) -> None:
        """Put it into its standing pose, with its soles on the ground."""
        angles = dict(zip(ROLES[1:4], np.radians(self.robot.stance), strict=True))
        for side in self.robot.legs:
            self.pose(context, side, angles)
        base = self.plant.GetBodyByName(self.robot.base)
        lowest = min(self.corners(context, leg.foot)[2].min() for leg in self.robot.legs.values())
        here = self.plant.EvalBodyPoseInWorld(context, base)
        raised = RigidTransform(here.rotation(), here.translation() - [0.0, 0.0, lowest])
        self.plant.SetFreeBodyPose(context, base, raised)

    def com(self, context: Context) -> np.ndarray:
        return np.array(self.plant.CalcCenterOfMassPositionInWorld(context))


def build(robot: Other) -> Built:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.002), builder)
    parser = Parser(plant)
    parser.SetStrictParsing()
    parser.AddModels(str(robot.file))
    ground = ProximityProperties()
    AddContactMaterial(5.0, None, CoulombFriction(1.0, 1.0), ground)
    AddRigidHydroelasticProperties(ground)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "ground", ground
    )
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        actuator.set_controller_gains(PdControllerGains(p=robot.stiffness, d=0.0))
        actuator.joint().set_default_damping_vector(np.array([robot.damping]))
    for leg in robot.legs.values():
        if leg.toe is not None:
            hinge = plant.GetJointByName(f"{leg.toe}_hinge")
            plant.AddForceElement(RevoluteSpring(hinge, 0.0, robot.toe_spring))
    plant.Finalize()
    built = Built(
        robot=robot,
        diagram=builder.Build(),
        plant=plant,
        scene_graph=scene_graph,
    )
    for leg in robot.legs.values():
        for link in (leg.foot, leg.toe):
            if link is not None:
                make_compliant(built, plant.GetBodyByName(link))
    return built


def make_compliant(built: Built, body: RigidBody) -> None:
    """Give boxes a hydroelastic surface, which MJCF cannot tell Drake."""
    for geometry, _, _ in built.boxes(body):
        had = built.scene_graph.model_inspector().GetProximityProperties(geometry)
        if had.HasProperty("hydroelastic", "compliance_type"):
            continue
        now = ProximityProperties(had)
        AddContactMaterial(5.0, None, None, now)
        AddCompliantHydroelasticProperties(0.01, 1e6, now)
        source = built.plant.get_source_id()
        built.scene_graph.RemoveRole(source, geometry, Role.kProximity)
        built.scene_graph.AssignRole(source, geometry, now)


@pytest.fixture(scope="module", params=ROBOTS)
def built(request: pytest.FixtureRequest) -> Built:
    return build(ROBOTS[request.param])


@pytest.fixture(scope="module")
def op3() -> Built:
    return build(OP3)


def sides(built: Built) -> tuple[str, str]:
    """The names of the left and of the right leg."""
    left, right = built.robot.legs
    return left, right


def test_every_inertia_is_physical(built: Built) -> None:
    context = built.plant.CreateDefaultContext()
    base = built.plant.GetBodyByName(built.robot.base)
    for index in built.plant.GetBodyIndices(base.model_instance()):
        inertia = built.plant.get_body(index).CalcSpatialInertiaInBodyFrame(context)
        assert inertia.IsPhysicallyValid()
        assert inertia.get_mass() > 0.0


@pytest.mark.parametrize(
    ("role", "axis", "direction"),
    [
        ("hip_pitch", 0, +1),  # hip flexion brings the foot forward
        ("knee", 0, -1),  # knee flexion brings it back
        ("ankle_pitch", 2, +1),  # dorsiflexion lifts the front of the foot
        ("hip_roll", 1, +1),  # the legs lean over the right foot: feet to the left of the torso
        ("ankle_roll", 2, -1),  # and the sole's left edge is lowered, which levels it
    ],
)
def test_joints_by_their_signs_turn_as_those_of_the_khr3hv(
    built: Built, role: str, axis: int, direction: int
) -> None:
    plant = built.plant
    for side, leg in built.robot.legs.items():
        if role not in leg.joints:
            assert built.robot is STIFF_HIPS
            continue
        context = plant.CreateDefaultContext()
        before = built.corners(context, leg.foot)
        built.pose(context, side, {role: 0.2})
        moved = built.corners(context, leg.foot) - before
        probe = {"ankle_pitch": before[0].argmax(), "ankle_roll": before[1].argmax()}.get(role, 0)
        assert direction * moved[axis, probe] > 1e-3


def test_equal_rolls_keep_soles_and_torso_level(built: Built) -> None:
    context = built.plant.CreateDefaultContext()
    for side, leg in built.robot.legs.items():
        if "hip_roll" in leg.joints:
            built.pose(context, side, {"hip_roll": 0.1, "ankle_roll": 0.1})
        foot = built.plant.EvalBodyPoseInWorld(context, built.plant.GetBodyByName(leg.foot))
        assert foot.rotation().matrix() == pytest.approx(np.eye(3), abs=1e-12)


def test_the_right_leg_mirrors_the_left(built: Built) -> None:
    plant, (left, right) = built.plant, sides(built)
    context = plant.CreateDefaultContext()
    angles = dict(zip(ROLES, (0.1, 0.5, 0.8, 0.2, -0.15), strict=True))
    built.pose(context, left, angles)
    built.pose(context, right, {r: -a if "roll" in r else a for r, a in angles.items()})
    links = [
        plant.get_body(index).name()
        for index in plant.GetBodyIndices(plant.GetBodyByName(built.robot.base).model_instance())
    ]
    on_left = [link for link in links if link.startswith(f"{left}_")]
    assert len(on_left) == (len(links) - 1) / 2
    base = plant.GetBodyByName(built.robot.base).default_com()
    assert base[1] == pytest.approx(0.0, abs=1e-15)
    for link in on_left:
        twin = right + link.removeprefix(left)
        bodies = [plant.GetBodyByName(name) for name in (link, twin)]
        poses = [plant.EvalBodyPoseInWorld(context, body) for body in bodies]
        assert poses[1].translation() == pytest.approx(MIRROR @ poses[0].translation(), abs=1e-12)
        assert poses[1].rotation().matrix() == pytest.approx(
            MIRROR @ poses[0].rotation().matrix() @ MIRROR, abs=1e-12
        )
        inertias = [body.CalcSpatialInertiaInBodyFrame(context) for body in bodies]
        assert inertias[1].get_mass() == inertias[0].get_mass()
        assert inertias[1].get_com() == pytest.approx(MIRROR @ inertias[0].get_com(), abs=1e-15)
        moments = [one.CalcRotationalInertia().CopyToFullMatrix3() for one in inertias]
        assert moments[1] == pytest.approx(MIRROR @ moments[0] @ MIRROR, abs=1e-15)
        if list(built.boxes(bodies[0])):
            ends = [built.corners(context, name) for name in (link, twin)]
            ends[0] = MIRROR @ ends[0]
            for low_or_high in (np.min, np.max):
                found = low_or_high(ends[1], axis=1)
                assert found == pytest.approx(low_or_high(ends[0], axis=1), abs=1e-12)


def test_it_stands_with_flat_soles_and_its_centre_of_mass_over_them(built: Built) -> None:
    context = built.plant.CreateDefaultContext()
    built.stand(context)
    soles = [built.corners(context, leg.foot) for leg in built.robot.legs.values()]
    for sole in soles:
        assert sorted(sole[2])[:4] == pytest.approx([0.0] * 4, abs=1e-12)
    both, com = np.hstack(soles), built.com(context)
    assert com[1] == pytest.approx(0.0, abs=1e-12)
    margin = np.ptp(both[0]) / 4.0
    assert both[0].min() + margin < com[0] < both[0].max() - margin


def test_it_stands_still_on_its_servos_for_two_seconds(built: Built) -> None:
    plant = built.plant
    context = built.diagram.CreateDefaultContext()
    inner = plant.GetMyMutableContextFromRoot(context)
    built.stand(inner)
    base = plant.GetBodyByName(built.robot.base)
    instance = base.model_instance()
    wanted = [
        plant.get_joint_actuator(index).joint().GetOnePosition(inner)
        for index in plant.GetJointActuatorIndices()
    ]
    plant.get_desired_state_input_port(instance).FixValue(inner, [*wanted, *(0.0 for _ in wanted)])
    start, com = plant.EvalBodyPoseInWorld(inner, base), built.com(inner)
    simulator = Simulator(built.diagram, context)
    simulator.AdvanceTo(2.0)
    end = plant.EvalBodyPoseInWorld(inner, base)
    # The servos give way under the weight: the OP3's most, by 3.2 mm and 1.5 degrees.
    assert np.linalg.norm(built.com(inner) - com) < 0.005
    assert (start.rotation().inverse() @ end.rotation()).ToAngleAxis().angle() < np.radians(2.0)
    assert np.abs(plant.GetVelocities(inner)).max() < 0.01
    contacts = plant.get_contact_results_output_port().Eval(inner)
    forces = [
        contacts.hydroelastic_contact_info(i).F_Ac_W().translational()[2]
        for i in range(contacts.num_hydroelastic_contacts())
    ]
    weight = 9.81 * plant.CalcTotalMass(inner)
    assert np.abs(forces).sum() == pytest.approx(weight, rel=0.02)
    assert contacts.num_point_pair_contacts() == 0


def test_the_op3_has_the_published_weight_and_height(op3: Built) -> None:
    context = op3.plant.CreateDefaultContext()
    mass = op3.plant.CalcTotalMass(context)
    assert mass == pytest.approx(3.14747, abs=1e-9)  # the sum of the URDF's links
    assert 0.89 * 3.5 < mass < 3.5  # the manual's figure
    assert op3.corners(context, "body_link")[2].max() == pytest.approx(0.510, abs=0.002)
    assert op3.corners(context, "l_ank_roll_link")[2].min() == pytest.approx(0.0, abs=1e-12)


def test_the_op3_has_the_published_links_and_feet(op3: Built) -> None:
    context, plant = op3.plant.CreateDefaultContext(), op3.plant
    places = {
        name: plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(f"l_{name}_link"))
        for name in ("hip_pitch", "knee", "ank_pitch", "ank_roll")
    }
    height = {name: place.translation()[2] for name, place in places.items()}
    assert height["hip_pitch"] - height["knee"] == pytest.approx(0.11015)
    assert height["knee"] - height["ank_pitch"] == pytest.approx(0.110)
    assert np.ptp(op3.corners(context, "l_ank_roll_link"), axis=1)[:2] == pytest.approx(
        [0.127, 0.078]
    )


def test_the_op3_has_twelve_servos_of_the_datasheets_torque(op3: Built) -> None:
    actuators = [
        op3.plant.get_joint_actuator(index) for index in op3.plant.GetJointActuatorIndices()
    ]
    assert len(actuators) == 12
    for actuator in actuators:
        assert actuator.effort_limit() == 4.1
        assert np.degrees(actuator.joint().position_upper_limits()) == pytest.approx([162.0])


def waveforms(time: float, period: float) -> dict[str, dict[str, float]]:
    """Angles of a walk [rad] as the KHR-3HV's, that grow from nothing in 0.4 s."""
    table = {
        "roll": (0.0, 2.5, 8.0, 0.0),
        "hip_pitch": (16.0, -7.5, 7.0, 0.5),
        "knee": (36.0, -1.0, 16.3, -0.6),
        "ankle_pitch": (20.6, 6.5, 9.3, -1.1),
    }
    grown = np.radians(0.5 - 0.5 * np.cos(np.pi * min(time / 0.4, 1.0)))
    legs: dict[str, dict[str, float]] = {}
    for side, phase in (("l", 0.0), ("r", np.pi)):
        angle = 2.0 * np.pi * time / period
        legs[side] = {}
        for name, row in table.items():
            turn = angle if name == "roll" else angle + phase
            basis = np.array([1.0, np.cos(turn), np.sin(turn), np.cos(2.0 * turn)])
            for role in ("hip_roll", "ankle_roll") if name == "roll" else (name,):
                legs[side][role] = float(grown * np.dot(row, basis))
    return legs


def walk(built: Built, *, mirrored: bool) -> tuple[np.ndarray, np.ndarray]:
    """Two seconds of walking: the centre of mass [m] (n, 3), the heights of both soles (n, 2)."""
    plant = built.plant
    context = built.diagram.CreateDefaultContext()
    inner = plant.GetMyMutableContextFromRoot(context)
    port = plant.get_desired_state_input_port(
        plant.GetBodyByName(built.robot.base).model_instance()
    )
    order = [
        plant.get_joint_actuator(index).joint().name() for index in plant.GetJointActuatorIndices()
    ]
    simulator = Simulator(built.diagram, context)
    path, heights = [], []
    for frame in range(100):
        angles = waveforms(frame * 0.02, 0.8)
        if mirrored:
            turned = {
                side: {role: -a if "roll" in role else a for role, a in leg.items()}
                for side, leg in angles.items()
            }
            angles = {"l": turned["r"], "r": turned["l"]}
        wanted = dict.fromkeys(order, 0.0)
        for side, leg in built.robot.legs.items():
            for role, (joint, sign) in leg.joints.items():
                wanted[joint] = sign * angles[side][role]
        port.FixValue(inner, [*wanted.values(), *(0.0 for _ in wanted)])
        simulator.AdvanceTo((frame + 1) * 0.02)
        path.append(built.com(inner))
        heights.append(
            [built.corners(inner, leg.foot)[2].min() for leg in built.robot.legs.values()]
        )
    return np.array(path), np.array(heights)


def test_the_op3_walks_and_a_mirrored_gait_walks_a_mirrored_path(op3: Built) -> None:
    path, heights = walk(op3, mirrored=False)
    assert path[-1, 0] - path[0, 0] > 0.15
    assert path[:, 2].min() > 0.24
    assert (heights.max(axis=0) > 0.003).all()
    # As far as the solver's tolerance allows: 0.01 mm.
    twin, twin_heights = walk(op3, mirrored=True)
    assert twin == pytest.approx(path @ MIRROR, abs=5e-5)
    assert twin_heights == pytest.approx(heights[:, ::-1], abs=5e-5)
