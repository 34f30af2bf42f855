"""The robot descriptions: what the datasheets, the CAD table and the paper say must be in them."""

import importlib.util
import itertools
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from pydrake.multibody.parsing import PackageMap, Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RevoluteSpring
from pydrake.systems.framework import DiagramBuilder

from drake_gait.errors import ModelError
from drake_gait.gait import JOINTS
from drake_gait.robot.description import model_path, models_folder
from drake_gait.robot.robot_file import default_robot
from drake_gait.simulation.contact import GROUND_FRICTION
from drake_gait.simulation.plant import Robot, add_robot, build_robot, sole_corners
from drake_gait.simulation.plant_config import PlantConfig

ROOT = Path(__file__).parents[2]
FILES = ("khr3hv.sdf", "khr3hv_cad.sdf")
LINKS = ("hip", "thigh", "shin", "ankle", "foot", "big_toe", "lesser_toes")


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_models", ROOT / "tools/make_models.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["make_models"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", params=FILES)
def plant(request: pytest.FixtureRequest) -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    parser = Parser(plant)
    parser.SetStrictParsing()
    parser.AddModels(str(model_path(request.param)))
    plant.Finalize()
    return plant


@pytest.fixture(scope="module")
def robot() -> Robot:
    return build_robot(PlantConfig())


def corners(robot: Robot, link: str) -> np.ndarray:
    """Corners of a link's collision boxes in the upright robot's frame, shape (3, n)."""
    body = robot.plant.GetBodyByName(link)
    X_WB = robot.plant.EvalBodyPoseInWorld(robot.plant.CreateDefaultContext(), body)
    return np.array(X_WB @ sole_corners(robot, body))


@pytest.mark.parametrize("name", [*FILES, "op3.sdf"])
def test_the_committed_file_is_what_the_maker_writes(maker: ModuleType, name: str) -> None:
    assert (models_folder() / name).read_text() == maker.MODEL_FILES[name]()


def test_the_links_and_joints_have_the_names_of_the_documentation(plant: MultibodyPlant) -> None:
    instance = plant.GetModelInstanceByName("khr3hv")
    links = {plant.get_body(index).name() for index in plant.GetBodyIndices(instance)}
    assert links == {"torso"} | {f"{link}_{side}" for link in LINKS for side in "rl"}
    joints = {plant.get_joint(index).name() for index in plant.GetJointIndices(instance)}
    assert joints - {"torso"} == {*JOINTS, *default_robot().hinges}


def test_the_robot_weighs_what_the_maker_says(plant: MultibodyPlant) -> None:
    assert plant.CalcTotalMass(plant.CreateDefaultContext()) == pytest.approx(1.5, abs=1e-9)


def test_the_standing_centre_of_mass_is_where_the_papers_limit_means_upright() -> None:
    heights = {}
    for name in FILES:
        robot = build_robot(PlantConfig(model=name))
        context = robot.plant.CreateDefaultContext()
        x, y, heights[name] = robot.plant.CalcCenterOfMassPositionInWorld(context)
        assert y == pytest.approx(0.0, abs=1e-9)
        assert -0.0539 < x < 0.0411  # over the heel parts
    assert heights["khr3hv.sdf"] == pytest.approx(0.2450, abs=1e-4)
    assert heights["khr3hv_cad.sdf"] == pytest.approx(0.2194, abs=1e-4)  # the CAD's own


def test_every_inertia_is_physical(plant: MultibodyPlant) -> None:
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName("khr3hv")):
        inertia = plant.get_body(index).CalcSpatialInertiaInBodyFrame(plant.CreateDefaultContext())
        assert inertia.IsPhysicallyValid()


def test_the_highest_point_is_the_height_of_the_robot(robot: Robot) -> None:
    assert corners(robot, "torso")[2].max() == pytest.approx(0.40105, abs=1e-6)


def test_the_foot_has_the_papers_sizes(robot: Robot) -> None:
    for side, inward in (("r", 1.0), ("l", -1.0)):
        heel = corners(robot, f"foot_{side}")
        big, lesser = corners(robot, f"big_toe_{side}"), corners(robot, f"lesser_toes_{side}")
        whole = np.hstack([heel, big, lesser])
        assert np.ptp(heel[0]) == pytest.approx(0.095)
        assert np.ptp(whole[0]) == pytest.approx(0.123)
        assert np.ptp(whole[1]) == pytest.approx(0.078)
        assert np.ptp(big[1]) == pytest.approx(0.022)
        assert np.ptp(lesser[1]) == pytest.approx(0.078 - 0.022 - 0.001)
        assert whole[2].min() == pytest.approx(0.0, abs=1e-9)
        # The big toe is on the inner side.
        assert (inward * (big[1].mean() - lesser[1].mean())) > 0.0


def test_the_feet_stand_apart(robot: Robot) -> None:
    assert corners(robot, "foot_l")[1].min() - corners(robot, "foot_r")[1].max() > 0.004


def test_servos_have_the_datasheets_stall_torque_and_the_toes_have_none(
    plant: MultibodyPlant,
) -> None:
    for name in JOINTS:
        actuator = plant.GetJointActuatorByName(name)
        assert actuator.effort_limit() == pytest.approx(1.373)
        assert actuator.default_rotor_inertia() == pytest.approx(1e-3)
    assert plant.num_actuators() == len(JOINTS)


def test_the_toes_turn_up_to_thirty_degrees_on_the_papers_springs(robot: Robot) -> None:
    expected = {"big_toe": 0.52, "lesser_toes": 0.26}  # N·mm/deg
    for hinge, spring in zip(default_robot().hinges, robot.springs, strict=True):
        joint = robot.plant.GetJointByName(hinge)
        assert np.degrees(joint.position_lower_limits()) == pytest.approx([0.0])
        assert np.degrees(joint.position_upper_limits()) == pytest.approx([30.0])
        stiffness = expected[hinge.split("_hinge")[0]] * 1e-3 * 180.0 / np.pi
        assert isinstance(spring, RevoluteSpring)
        assert spring.joint().name() == hinge
        assert spring.default_stiffness() == pytest.approx(stiffness)


@pytest.mark.parametrize("factor", [1.0, 0.9, 0.05, 2.25])
@pytest.mark.parametrize(
    ("links", "pair"), [(("foot",), (0.5, 0.417)), (("big_toe", "lesser_toes"), (0.17, 0.155))]
)
def test_sole_and_ground_combine_to_the_papers_friction_times_the_factor(
    links: tuple[str, ...], pair: tuple[float, float], factor: float
) -> None:
    robot = build_robot(PlantConfig(friction=factor))
    inspector = robot.scene_graph.model_inspector()
    for link, side in itertools.product(links, "rl"):
        body = robot.plant.GetBodyByName(f"{link}_{side}")
        for geometry in robot.plant.GetCollisionGeometriesForBody(body):
            properties = inspector.GetProximityProperties(geometry)
            friction = properties.GetProperty("material", "coulomb_friction")
            for surface, wanted in zip(
                (friction.static_friction(), friction.dynamic_friction()), pair, strict=True
            ):
                ground = GROUND_FRICTION
                combined = 2.0 * surface * ground / (surface + ground)
                assert combined == pytest.approx(factor * wanted, abs=3e-6)


def frictions(factor: float) -> list[float]:
    """Coefficients of every shape of the robot."""
    robot = build_robot(PlantConfig(friction=factor))
    inspector, found = robot.scene_graph.model_inspector(), []
    for index in robot.plant.GetBodyIndices(robot.plant.GetModelInstanceByName("khr3hv")):
        for geometry in robot.plant.GetCollisionGeometriesForBody(robot.plant.get_body(index)):
            properties = inspector.GetProximityProperties(geometry)
            if properties is None:  # It is out of reach.
                continue
            pair = properties.GetProperty("material", "coulomb_friction")
            found += [pair.static_friction(), pair.dynamic_friction()]
    return found


def test_all_shapes_have_another_friction_on_other_ground() -> None:
    same, changed = np.array(frictions(1.0)), np.array(frictions(0.6))
    on_the_ground = [2.0 * one * GROUND_FRICTION / (one + GROUND_FRICTION)
                     for one in (same, changed)]  # fmt: skip
    assert on_the_ground[1] == pytest.approx(0.6 * on_the_ground[0])


@pytest.mark.parametrize(
    ("value", "factor", "complaint"),
    [
        ("", 0.9, "<drake:mu_static> must be a number, got ''"),
        ("slippery", 0.9, "<drake:mu_static> must be a number, got 'slippery'"),
        ("1.0", 2.0, "no surface has 2 times the friction 1 of link"),
    ],
)
def test_a_friction_that_cannot_be_multiplied_is_refused_in_one_line(
    tmp_path: Path, value: str, factor: float, complaint: str
) -> None:
    text = model_path().read_text()
    pattern = r"(<drake:mu_static>)[^<]*"
    model = tmp_path / "robot.sdf"
    model.write_text(re.sub(pattern, rf"\g<1>{value}", text))
    with pytest.raises(ModelError) as refusal:
        build_robot(PlantConfig(model=model, friction=factor))
    assert str(refusal.value).startswith(f"{model}")
    assert complaint in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("joint", "probe", "axis", "sign"),
    [
        ("hip_pitch", "foot", 0, +1),  # hip flexion brings the foot forward
        ("knee", "foot", 0, -1),  # knee flexion brings it back
        ("ankle_pitch", "big_toe", 2, +1),  # dorsiflexion lifts the toes
        ("big_toe_hinge", "big_toe", 2, +1),  # extension lifts the toe
        ("lesser_toes_hinge", "lesser_toes", 2, +1),
        ("hip_roll", "foot", 1, +1),  # the legs lean over the right foot:
        ("ankle_roll", "foot", 2, 0),  # feet to the left of the torso, and level
    ],
)
def test_positive_angles_bend_the_robot_as_documented(
    robot: Robot, joint: str, probe: str, axis: int, sign: int
) -> None:
    plant = robot.plant
    for side in "rl":
        context = plant.CreateDefaultContext()
        body = plant.GetBodyByName(f"{probe}_{side}")
        com = body.default_com()

        def place(body=body, context=context, com=com) -> np.ndarray:  # type: ignore[no-untyped-def]
            return plant.EvalBodyPoseInWorld(context, body) @ com

        before = place()
        plant.GetJointByName(f"{joint}_{side}").set_angle(context, 0.2)
        moved = (place() - before)[axis]
        if sign:
            assert np.sign(moved) == sign
            assert abs(moved) > 1e-3
        else:
            assert abs(moved) < 0.01


def test_hip_plus_ankle_equal_to_knee_keeps_the_foot_flat(robot: Robot) -> None:
    plant = robot.plant
    context = plant.CreateDefaultContext()
    for joint, degrees in (("hip_pitch", 15.0), ("knee", 30.0), ("ankle_pitch", 15.0)):
        plant.GetJointByName(f"{joint}_l").set_angle(context, np.radians(degrees))
    foot = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("foot_l"))
    assert foot.rotation().matrix() == pytest.approx(np.eye(3), abs=1e-12)


def test_equal_roll_angles_keep_torso_and_soles_level(robot: Robot) -> None:
    plant = robot.plant
    context = plant.CreateDefaultContext()
    for joint, side in itertools.product(("hip_roll", "ankle_roll"), "rl"):
        plant.GetJointByName(f"{joint}_{side}").set_angle(context, 0.1)
    torso = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("torso"))
    for side in "rl":
        foot = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(f"foot_{side}"))
        assert foot.rotation().matrix() == pytest.approx(torso.rotation().matrix(), abs=1e-12)


def test_the_package_resolves_for_any_drake_program() -> None:
    packages = PackageMap()
    packages.AddPackageXml(models_folder() / "package.xml")
    assert Path(packages.ResolveUrl("package://drake_gait/khr3hv.sdf")).is_file()


def test_the_robot_collides_with_the_ground_everywhere_it_could_lie_on() -> None:
    builder = DiagramBuilder()
    plant, _ = add_robot(builder, PlantConfig())
    for link in ("torso", "hip_l", "thigh_l", "shin_l", "foot_l", "thigh_r", "foot_r"):
        assert plant.GetCollisionGeometriesForBody(plant.GetBodyByName(link)), link
