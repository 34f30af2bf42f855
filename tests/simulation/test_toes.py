"""Designed toes: what a width, a length and rigid toes change in the robot and in its walk."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Box
from pydrake.multibody.tree import RigidBody

from drake_gait import Candidate, FootDesign, WalkSettings, simulate
from drake_gait.foot import DESIGN_LIMITS
from drake_gait.gait import JOINTS, FloatArray
from drake_gait.robot.description import model_path
from drake_gait.robot.robot_file import default_robot
from drake_gait.robot.sdf import remove_looks
from drake_gait.robot.sdf_checks import tree
from drake_gait.simulation import simulate as simulation
from drake_gait.simulation.collision import box_corners
from drake_gait.simulation.plant import Robot, build_robot, sole_corners
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.simulate import follow, prepare
from drake_gait.simulation.toes import with_toes
from drake_gait.study.reading import default_study, read_study

MODELS = ("khr3hv.sdf", "khr3hv_cad.sdf")
WALKING = Candidate(gait=read_study(default_study()).space.decode(np.zeros(16)).gait)
NUMBERS = ("outcome", "frames", "forward", "lateral", "yaw", "com_height")

THICKNESS = 0.005


def robot_with(model: str = MODELS[0], **design: float) -> Robot:
    return build_robot(PlantConfig(model=model, foot=FootDesign(**design)))


def body_values(robot: Robot, body: RigidBody) -> tuple[float, FloatArray, FloatArray]:
    """Mass, centre of mass in the body's frame, and moments about that centre."""
    context = robot.plant.CreateDefaultContext()
    inertia = body.CalcSpatialInertiaInBodyFrame(context)
    com = inertia.get_com()
    central = inertia.CalcRotationalInertia().ShiftToCenterOfMass(inertia.get_mass(), com)
    return inertia.get_mass(), com, central.CopyToFullMatrix3()


def outline(robot: Robot, link: str) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner of a link's box in the upright robot's frame."""
    body = robot.plant.GetBodyByName(link)
    X_WB = robot.plant.EvalBodyPoseInWorld(robot.plant.CreateDefaultContext(), body)
    corners = X_WB @ sole_corners(robot, body)
    return corners.min(axis=1), corners.max(axis=1)


def of_walk(candidate: Candidate) -> tuple[object, ...]:
    walk = simulate(candidate)
    return tuple(getattr(walk, name) for name in NUMBERS)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("width", "length"), [(0.022, 0.028), (0.008, 0.028), (0.050, 0.028), (0.031, 0.017)]
)
def test_mass_and_inertia_of_both_toes_are_those_of_their_plates(
    model: str, width: float, length: float
) -> None:
    robot, paper = robot_with(model, big_toe_width=width, toe_length=length), robot_with(model)
    paper_mass, _, _ = body_values(paper, paper.plant.GetBodyByName("big_toe_l"))
    density = paper_mass / (0.022 * 0.028)  # kg/m²
    widths = {"big_toe": width, "lesser_toes": 0.078 - 0.001 - width}
    for toe, side in ((toe, side) for toe in widths for side in "rl"):
        body = robot.plant.GetBodyByName(f"{toe}_{side}")
        mass, com, inertia = body_values(robot, body)
        assert mass == pytest.approx(density * widths[toe] * length, rel=1e-9)
        moments = (
            mass
            / 12.0
            * np.array(
                [
                    widths[toe] ** 2 + THICKNESS**2,
                    length**2 + THICKNESS**2,
                    length**2 + widths[toe] ** 2,
                ]
            )
        )
        assert inertia == pytest.approx(np.diag(moments), rel=1e-9, abs=1e-18)
        # The hinge is at the rear end of the plate.
        assert com[[0, 2]] == pytest.approx([length / 2.0, 0.0], abs=1e-15)
        (geometry,) = box_corners(robot.plant, robot.scene_graph, body)
        shape = robot.scene_graph.model_inspector().GetShape(geometry)
        assert isinstance(shape, Box)
        assert shape.size() == pytest.approx([length, widths[toe], THICKNESS], rel=1e-12)


@pytest.mark.parametrize(
    "design",
    [
        *({"big_toe_width": value} for value in DESIGN_LIMITS["big_toe_width"]),
        *({"toe_length": value} for value in DESIGN_LIMITS["toe_length"]),
        {"rigid_toes": True},
    ],
    ids=str,
)
def test_whatever_the_toes_are_the_outline_of_the_foot_stays(design: dict[str, float]) -> None:
    robot, paper = robot_with(**design), robot_with()
    foot = FootDesign(**design)
    for side, inward in (("r", 1), ("l", -1)):
        links = [f"{link}_{side}" for link in ("foot", "big_toe", "lesser_toes")]
        edges = [outline(robot, link) for link in links]
        before = [outline(paper, link) for link in links]
        for pick, reduce in ((0, np.min), (1, np.max)):
            whole = reduce([edge[pick] for edge in edges], axis=0)
            assert whole == pytest.approx(
                reduce([edge[pick] for edge in before], axis=0), abs=1e-12
            )
        heel, big, lesser = edges
        assert heel[1][0] == pytest.approx(big[0][0], abs=1e-12)
        assert heel[1][0] == pytest.approx(lesser[0][0], abs=1e-12)
        assert big[1][0] - big[0][0] == pytest.approx(foot.toe_length, abs=1e-12)
        # The gap stays, with the big toe on the inner side.
        gap = big[0][1] - lesser[1][1] if inward > 0 else lesser[0][1] - big[1][1]
        assert gap == pytest.approx(0.001, abs=1e-12)


@pytest.mark.parametrize("length", DESIGN_LIMITS["toe_length"])
def test_the_heel_part_takes_what_the_toes_leave_with_its_mass_and_inertia(length: float) -> None:
    robot, paper = robot_with(toe_length=length), robot_with()
    growth = 0.028 - length
    for side in "rl":
        heel, before = (
            body_values(other, other.plant.GetBodyByName(f"foot_{side}"))
            for other in (robot, paper)
        )
        toe, _, _ = body_values(paper, paper.plant.GetBodyByName(f"big_toe_{side}"))
        strip = toe / (0.022 * 0.028) * growth * 0.078
        assert heel[0] == pytest.approx(before[0] + strip, rel=1e-12)
        # Steiner's theorem about the heel part's old centre of mass, for the moment about y.
        lower, upper = outline(paper, f"foot_{side}")
        body = paper.plant.GetBodyByName(f"foot_{side}")
        X_WB = paper.plant.EvalBodyPoseInWorld(paper.plant.CreateDefaultContext(), body)
        front = np.array([upper[0] + growth / 2.0, (lower[1] + upper[1]) / 2.0, THICKNESS / 2.0])
        arm = front - (X_WB.translation() + before[1])
        shift = heel[1] - before[1]
        assert shift == pytest.approx(strip * arm / heel[0], abs=1e-12)
        square = growth**2 + THICKNESS**2
        about_old = strip * (square / 12.0 + arm[0] ** 2 + arm[2] ** 2) + before[2][1, 1]
        moved = heel[0] * (shift[0] ** 2 + shift[2] ** 2)
        assert heel[2][1, 1] == pytest.approx(about_old - moved, rel=1e-9)
        context = robot.plant.CreateDefaultContext()
        foot = robot.plant.GetBodyByName(f"foot_{side}")
        assert foot.CalcSpatialInertiaInBodyFrame(context).IsPhysicallyValid()


def test_the_paper_s_foot_is_the_description_itself() -> None:
    before, after = (tree(model_path().read_bytes(), default_robot()) for _ in range(2))
    with_toes(after, FootDesign(), default_robot())
    assert len(list(before.iter())) == len(list(after.iter()))
    for was, is_now in zip(before.iter(), after.iter(), strict=True):
        assert (was.tag, was.attrib) == (is_now.tag, is_now.attrib)
        try:
            numbers = [float(value) for value in (was.text or "").split()]
        except ValueError:
            assert was.text == is_now.text
        else:
            assert [float(value) for value in (is_now.text or "").split()] == pytest.approx(
                numbers, rel=1e-9, abs=1e-15
            )


def test_looks_change_no_walk_s_robot() -> None:
    bare = tree(model_path().read_bytes(), default_robot())
    shapes = len(list(bare.iter("collision")))
    assert list(bare.iter("visual"))
    remove_looks(bare)
    assert not list(bare.iter("visual"))
    assert len(list(bare.iter("collision"))) == shapes > 0


def test_springs_set_in_place_walk_as_those_the_robot_was_built_with() -> None:
    sprung = FootDesign(
        big_toe_stiffness=0.11, lesser_toes_stiffness=0.05, toe_damping=7e-4, big_toe_width=0.03
    )
    candidate = replace(WALKING, foot=sprung)
    simulate(replace(WALKING, foot=sprung.body))  # The diagram is built for other springs.
    in_place = of_walk(candidate)
    simulation._robot.cache_clear()
    assert of_walk(candidate) == in_place
    assert of_walk(replace(WALKING, foot=sprung.body)) != in_place


def test_a_foot_walks_the_same_after_any_number_of_others() -> None:
    first = of_walk(replace(WALKING, foot=FootDesign(big_toe_width=0.03)))
    for width in (0.010, 0.015, 0.020, 0.025, 0.035, 0.040):  # more than are kept
        prepare(WALKING.gait.commands, FootDesign(big_toe_width=width), WalkSettings())
    assert of_walk(replace(WALKING, foot=FootDesign(big_toe_width=0.03))) == first


def test_springs_need_no_new_robot_and_another_body_does() -> None:
    settings, commands = WalkSettings(), WALKING.gait.commands
    usual, _ = prepare(commands, FootDesign(), settings)
    assert prepare(commands, FootDesign(toe_damping=1e-3), settings)[0] is usual
    assert prepare(commands, FootDesign(toe_length=0.02), settings)[0] is not usual


def test_rigid_toes_do_not_bend_and_take_four_degrees_of_freedom() -> None:
    rigid, sprung = robot_with(rigid_toes=True).plant, robot_with().plant
    assert sprung.num_velocities() - rigid.num_velocities() == len(default_robot().hinges) == 4
    assert rigid.num_actuators() == len(JOINTS)
    walk = simulate(replace(WALKING, foot=FootDesign(rigid_toes=True)), history=True)
    assert walk.history is not None
    assert walk.measures is not None
    assert (walk.history.toes == 0.0).all()
    assert walk.measures.toe_range == (0.0, 0.0, 0.0, 0.0)
    assert walk.history.positions.shape == (241, 17)
    assert walk.forward != simulate(WALKING).forward


def test_rigid_toes_stand_on_the_whole_foot() -> None:
    still: FloatArray = np.zeros((241, 10))
    walk = follow(still, FootDesign(rigid_toes=True), history=True)
    assert walk.history is not None
    weight = 1.5 * 9.81
    assert walk.history.ground_reaction[-50:, :, 2].sum(axis=1).mean() == pytest.approx(
        weight, rel=0.01
    )


def mirrored(commands: FloatArray) -> FloatArray:
    """The commands of the robot in a mirror: legs exchanged, roll to the other side."""
    twin = np.empty_like(commands)
    for column, name in enumerate(JOINTS):
        side = {"r": "l", "l": "r"}[name[-1]]
        sign = -1.0 if "roll" in name else 1.0
        twin[:, column] = sign * commands[:, JOINTS.index(f"{name[:-1]}{side}")]
    return twin


@pytest.mark.parametrize(
    "design",
    [
        {"big_toe_width": 0.040, "big_toe_stiffness": 0.08, "toe_length": 0.020},
        {"rigid_toes": True},
    ],
    ids=["designed", "rigid"],
)
def test_a_mirrored_gait_on_a_designed_foot_walks_a_mirrored_path(
    design: dict[str, float],
) -> None:
    foot = FootDesign(**design)
    walk, twin = (follow(each, foot) for each in
                  (WALKING.gait.commands, mirrored(WALKING.gait.commands)))  # fmt: skip
    assert walk.survived
    assert twin.forward == pytest.approx(walk.forward, abs=2e-3)
    assert twin.lateral == pytest.approx(-walk.lateral, abs=3e-3)
    assert twin.yaw == pytest.approx(-walk.yaw, abs=np.radians(1.5))
