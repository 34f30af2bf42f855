"""Measures of walks: from the log of their steps, and of walks that are easy to see through."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FloatArray, Gait
from drake_gait.problem import Candidate
from drake_gait.robot.description import model_path
from drake_gait.simulation.kinematics import Kinematics
from drake_gait.simulation.measures import Record, measures_of
from drake_gait.simulation.plant import build_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.simulate import measured_at_every_step
from drake_gait.simulation.tread import wet_part
from drake_gait.sole import Sole
from drake_gait.walk import Disturbance, WalkSettings

MIDDLE = Gait.from_degrees([(0, -1.5, 3, 0), (13, -11, 8, 0), (16, -3, 14, 0), (8, 8, 8.5, 0)])

A_TAIL = """
    <link name="tail">
      <pose>-0.1 0 0.3 0 0.4 0</pose>
      <inertial><pose>0.01 0 0 0 0 0</pose><mass>0.05</mass>
        <inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia></inertial>
    </link>
    <joint name="tail_slide" type="prismatic">
      <parent>torso</parent><child>tail</child>
      <axis><xyz>0 0.6 0.8</xyz><limit><effort>0</effort></limit></axis>
    </joint>
  </model>"""


def random() -> np.random.Generator:
    return np.random.default_rng(19)


def models(folder: Path) -> list[str | Path]:
    """The shipped robot, and one with a link that slides."""
    tailed = folder / "tailed.sdf"
    text = model_path().read_text(encoding="utf-8")
    tailed.write_text(text.replace("</model>", A_TAIL), encoding="utf-8")
    return ["khr3hv.sdf", tailed]


@pytest.mark.parametrize("foot", [FootDesign(), FootDesign(rigid_toes=True)])
def test_links_move_as_drake_says(foot: FootDesign, tmp_path: Path) -> None:
    for model in models(tmp_path):
        plant = build_robot(PlantConfig(model=model, foot=foot)).plant
        kinematics, context = Kinematics(plant, "torso"), plant.CreateDefaultContext()
        states = random().standard_normal((plant.num_positions() + plant.num_velocities(), 3))
        motions = kinematics.motions(states)
        point = np.array([0.1, -0.2, 0.3])
        for instant, state in enumerate(states.T):
            plant.SetPositions(context, state[: plant.num_positions()])
            plant.SetVelocities(context, state[plant.num_positions() :])
            for index in plant.GetBodyIndices(plant.GetBodyByName("torso").model_instance()):
                body = plant.get_body(index)
                link, X_LB = kinematics.fixed(body.name())
                moved: FloatArray = (X_LB @ point)[None]
                X_WB = plant.EvalBodyPoseInWorld(context, body)
                V_WB = plant.EvalBodySpatialVelocityInWorld(context, body)
                v_WP = V_WB.Shift(X_WB.rotation() @ point).translational()
                motion = motions[link]
                height, rising = motion.heights(moved)[0], motion.rising(moved)[0]
                assert height[instant] == pytest.approx((X_WB @ point)[2])
                assert rising[instant] == pytest.approx(v_WP[2])
                along = motion.rising(moved, X_LB.rotation() @ point)[0]
                assert along[instant] == pytest.approx(X_WB.rotation() @ point @ v_WP)
                np.testing.assert_allclose(motion.velocity_at(moved.T)[:, instant], v_WP)
            v_WC = plant.CalcCenterOfMassTranslationalVelocityInWorld(context)
            np.testing.assert_allclose(kinematics.centre_velocity(motions)[:, instant], v_WC)


def test_a_triangle_is_in_the_ground_by_as_much_as_its_points_are() -> None:
    depth = random().normal(size=(3, 40))
    mean, weights = wet_part(list(depth))
    places = random().dirichlet((1.0, 1.0, 1.0), size=40_000).T
    for triangle in range(depth.shape[1]):
        found = depth[:, triangle] @ places
        assert mean[triangle] == pytest.approx(np.maximum(found, 0.0).mean(), abs=0.02)
        if (found > 0.0).mean() > 0.02:
            centroid = places[:, found > 0.0].mean(axis=1)
            np.testing.assert_allclose([w[triangle] for w in weights], centroid, atol=0.03)


def test_what_is_in_the_ground_and_what_is_out_of_it_make_the_whole_triangle() -> None:
    depth = random().normal(size=(3, 400))
    under, over = wet_part(list(depth))[0], wet_part(list(-depth))[0]
    np.testing.assert_allclose(under - over, depth.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize(
    ("sole", "rigid"), [(Sole.AREA, False), (Sole.POINTS, True), (Sole.BOXES, False)]
)
def test_the_log_says_what_drake_s_own_contact_says(sole: Sole, rigid: bool) -> None:
    other = Disturbance(voltage=0.95, mass=1.05, joint_zeros=(0.003,) * 10) if rigid else None
    settings = WalkSettings(sole=sole, disturbance=other)
    candidate = Candidate(gait=MIDDLE, foot=FootDesign(rigid_toes=rigid))
    walk, exact = measured_at_every_step(candidate, settings)
    assert walk.measures is not None
    # Millimetres that slide while the load is near its threshold.
    assert walk.measures.slip == pytest.approx(exact.slip, rel=0.05, abs=0.003)
    assert walk.measures.duty_factor == pytest.approx(exact.duty_factor, abs=0.02, nan_ok=True)
    for name, value in asdict(walk.measures).items():
        if name not in ("slip", "duty_factor"):
            assert value == pytest.approx(getattr(exact, name), rel=1e-3, abs=1e-5), name


def test_measures_are_of_the_walk_up_to_its_fall() -> None:
    falling = Gait.from_degrees([(0, 6, 6, 0), (13, -11, 8, 0), (16, -3, 14, 0), (8, 8, 8.5, 0)])
    walk, exact = measured_at_every_step(Candidate(gait=falling), WalkSettings())
    assert not walk.survived
    assert walk.measures is not None
    assert walk.measures.energy == pytest.approx(exact.energy, rel=1e-3)
    assert walk.measures.slip == pytest.approx(exact.slip, rel=0.05, abs=0.002)


# --- Walks that are easy to see through ----------------------------------------------------------

STEPS = 1201
STANDS: dict[str, Any] = {
    "time": np.linspace(0.0, 4.8, STEPS),
    "frames": np.arange(0, STEPS, 5),
    "speeds": np.zeros((10, STEPS)),
    "controllers": np.zeros((10, STEPS)),
    "torques": np.zeros((10, STEPS)),
    "stall": np.full(10, 1.373),
    "loads": np.full((6, STEPS), 2.5),
    "sliding": np.zeros((6, STEPS)),
    "toes": np.zeros((4, 241)),
    "sole_height": np.full((2, 241), -2e-5),
    "rising": np.zeros(241),
    "upright": np.ones(241),
    "mass": 1.5,
    "gravity": 9.81,
    "load": 0.5,
}


def measured(forward: float = 0.0, **changes: Any) -> Any:
    """Measures of a robot that stands still, but for changes."""
    return measures_of(Record(**{**STANDS, **changes}), forward=forward)


def test_who_stands_still_has_no_slip_no_swing_and_both_feet_down() -> None:
    found = measured()
    assert found.slip == (0.0, 0.0)
    assert found.clearance == (0.0, 0.0)
    assert found.duty_factor == (1.0, 1.0)
    assert found.energy == found.peak_torque == found.torso_tilt == 0.0
    assert found.peak_ground_reaction == 1.0
    assert math.isinf(found.cost_of_transport)


def test_a_hop_lifts_both_feet_and_its_landing_presses_harder() -> None:
    aloft = slice(75, 85)  # Frames 1.5 to 1.7 s, of the second cycle of 1.2 to 2.4 s.
    loads, height = np.array(STANDS["loads"]), np.array(STANDS["sole_height"])
    loads[:, 5 * aloft.start : 5 * aloft.stop] = 0.0
    height[:, aloft] = 0.01 * np.sin(np.pi * (np.arange(10) + 0.5) / 10)
    rising = np.zeros(241)
    rising[aloft] = np.linspace(0.98, -0.98, 10)
    found = measured(loads=loads, sole_height=height, rising=rising)
    assert found.duty_factor == pytest.approx((50 / 60, 50 / 60))
    assert found.clearance == pytest.approx((0.01, 0.01), rel=0.02)
    assert found.peak_ground_reaction == pytest.approx(1.0 + 0.98 / (9.81 * FRAME_TIME))


def test_a_foot_slides_by_its_loaded_plate_alone() -> None:
    sliding, loads = np.zeros((6, STEPS)), np.array(STANDS["loads"])
    sliding[0] = 0.02  # The heel of the right foot, at 20 mm/s for 4.8 s.
    loads[1:3] = 1.0
    assert measured(sliding=sliding, loads=loads).slip == pytest.approx((0.096, 0.0))
    loads[0], loads[1:3] = 0.4, 0.0
    assert measured(sliding=sliding, loads=loads).slip == (0.0, 0.0)  # It brushes.
    loads[1] = 3.0
    assert measured(sliding=sliding, loads=loads).slip == (0.0, 0.0)  # It stands on a toe.


def test_a_dragged_toe_has_no_clearance_and_slides_where_it_is_loaded() -> None:
    sliding, loads = np.zeros((6, STEPS)), np.array(STANDS["loads"])
    loads[[0, 2]], loads[1] = 0.0, 0.8
    sliding[1] = 0.1
    height = np.full((2, 241), -1e-6)
    found = measured(sliding=sliding, loads=loads, sole_height=height)
    assert found.clearance == (0.0, 0.0)
    assert found.slip == pytest.approx((0.48, 0.0))
    assert found.duty_factor == (1.0, 1.0)


def test_work_is_split_into_driving_and_braking() -> None:
    speeds, torques = np.zeros((10, STEPS)), np.zeros((10, STEPS))
    torques[0], speeds[0] = 0.5, 1.0
    torques[1], speeds[1] = -0.25, 2.0
    controllers = np.zeros((10, STEPS))
    controllers[2] = -1.373
    found = measured(0.5, speeds=speeds, torques=torques, controllers=controllers)
    assert found.positive_energy == pytest.approx(2.4)
    assert found.energy == pytest.approx(4.8)
    assert found.cost_of_transport == pytest.approx(2.4 / (1.5 * 9.81 * 0.5))
    assert (found.peak_torque, found.peak_speed) == (0.5, 2.0)
    assert (found.driving_torque, found.braking_torque) == (0.5, 0.25)
    assert (found.driving_speed, found.braking_speed) == (1.0, 2.0)
    assert found.saturated_fraction == pytest.approx(0.1)


def test_the_share_of_the_line_is_that_of_torque_and_speed_while_a_servo_drives() -> None:
    stall, no_load = 1.373, 7.48
    speeds, torques = np.zeros((10, STEPS)), np.zeros((10, STEPS))
    torques[0], speeds[0] = 0.3 * stall, 0.5 * no_load
    torques[1], speeds[1] = -1.4 * stall, 0.4 * no_load  # Driven back: beyond the line.
    controllers = torques + stall / no_load * speeds
    found = measured(speeds=speeds, torques=torques, controllers=controllers)
    assert found.line_share == pytest.approx(0.8)
    assert found.braking_torque == pytest.approx(1.4 * stall)
    assert found.braking_speed == pytest.approx(0.4 * no_load)


def test_a_fall_before_the_second_cycle_has_no_duty_factor() -> None:
    short = {
        name: value[..., :201] for name, value in STANDS.items() if np.shape(value)[-1:] == (STEPS,)
    }
    frames = {name: STANDS[name][..., :41] for name in ("toes", "sole_height", "rising")}
    upright = np.linspace(1.0, math.cos(math.radians(50.0)), 41)
    found = measured(**short, **frames, frames=np.arange(0, 201, 5), upright=upright)
    assert all(map(math.isnan, found.duty_factor))
    assert math.degrees(found.torso_tilt) == pytest.approx(50.0)
