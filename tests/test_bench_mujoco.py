"""The robot in MuJoCo is the robot in Drake, as far as both can say it."""

import importlib
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, JOINTS, Gait
from drake_gait.robot.sdf import TOE_HINGES
from drake_gait.servo import Servo
from drake_gait.simulation.command_source import desired_state
from drake_gait.simulation.plant import build_robot, sole_corners
from drake_gait.simulation.plant_config import PlantConfig

HINGES = (*JOINTS, *TOE_HINGES)
FOOT = FootDesign(big_toe_width=0.030)  # not the table's width
BOXES = {"foot": "heel", "big_toe": "big_toe", "lesser_toes": "lesser_toes"}
SIGNS = np.array(np.meshgrid(*3 * [(-1, 1)], indexing="ij")).reshape(3, 8)


@pytest.fixture(scope="module")
def bench(repository: Path) -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(repository / "tools")
        return importlib.import_module("bench_mujoco")


@pytest.fixture
def model(bench: ModuleType) -> mujoco.MjModel:
    masses = bench.make_models.raised_masses()
    return mujoco.MjModel.from_xml_string(bench.mjcf(masses, FOOT, Servo(), 0.001))


def test_the_robot_in_mujoco_weighs_and_stands_as_the_maker_says(model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.body_mass.sum() == pytest.approx(1.5, abs=1e-9)
    assert data.body("torso").subtree_com[2] == pytest.approx(0.2450, abs=1e-4)


def in_order(corners: np.ndarray) -> np.ndarray:
    """Corners, shape (3, n), sorted: a mirrored box counts its own otherwise."""
    return corners[:, np.lexsort(np.round(corners, 6))]


def test_any_posture_is_the_same_in_both_engines(model: mujoco.MjModel) -> None:
    rng = np.random.default_rng(0)
    angles = dict(zip(HINGES, rng.uniform(0.05, 0.5, len(HINGES)), strict=True))
    X_WT = RigidTransform(RollPitchYaw(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-1.0, 1.0, 3))

    drake = build_robot(PlantConfig(foot=FOOT))
    plant, context = drake.plant, drake.plant.CreateDefaultContext()
    plant.SetFreeBodyPose(context, plant.GetBodyByName("torso"), X_WT)
    data = mujoco.MjData(model)
    data.joint("torso").qpos[:3] = X_WT.translation()
    data.joint("torso").qpos[3:] = X_WT.rotation().ToQuaternion().wxyz()
    for name, angle in angles.items():
        plant.GetJointByName(name).set_angle(context, angle)
        data.joint(name).qpos[:] = angle
    mujoco.mj_forward(model, data)

    com = plant.CalcCenterOfMassPositionInWorld(context)
    assert data.body("torso").subtree_com == pytest.approx(com, abs=1e-6)
    for side in "rl":
        for link, box in BOXES.items():
            body = plant.GetBodyByName(f"{link}_{side}")
            X_WB = plant.EvalBodyPoseInWorld(context, body)
            geom = f"{link}_{side}_{box}"
            p_GC = SIGNS * model.geom(geom).size[:, None]
            R_WG = data.geom(geom).xmat.reshape(3, 3)
            corners = R_WG @ p_GC + data.geom(geom).xpos[:, None]
            expected = X_WB @ sole_corners(drake, body)
            assert in_order(corners) == pytest.approx(in_order(expected), abs=1e-6)

    in_drake = [plant.GetJointByName(name).velocity_start() for name in HINGES]
    in_mujoco = [model.joint(name).dofadr[0] for name in HINGES]
    inertia = np.zeros((model.nv, model.nv))
    for column, unit in zip(inertia, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    expected = plant.CalcMassMatrix(context)[np.ix_(in_drake, in_drake)]
    assert inertia[np.ix_(in_mujoco, in_mujoco)] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("error", "speed"), [(0.03, 1.0), (0.5, 3.0), (-0.5, 7.48)])
def test_a_servo_in_mujoco_pulls_along_the_torque_speed_line(
    model: mujoco.MjModel, error: float, speed: float
) -> None:
    servo, stall = Servo(), 1.373
    data = mujoco.MjData(model)
    data.actuator(JOINTS.index("knee_l")).ctrl[:] = error
    data.joint("knee_l").qvel[:] = speed
    mujoco.mj_forward(model, data)
    torque = data.joint("knee_l").qfrc_actuator + data.joint("knee_l").qfrc_passive
    controlled = np.clip(servo.stiffness * error - servo.damping * speed, -stall, stall)
    assert torque == pytest.approx(controlled - stall * speed / servo.no_load_speed)


def test_mujoco_is_sent_the_commands_that_drake_is_sent(bench: ModuleType) -> None:
    commands = Gait(coefficients=np.random.default_rng(0).normal(size=(4, 4)) / 3.0).commands
    sent = bench.step_commands(commands, 0.001)
    expected = [desired_state(commands, 0.001 * step)[:10] for step in range(len(sent))]
    assert len(sent) == round(240 * FRAME_TIME / 0.001)
    assert sent == pytest.approx(np.array(expected), abs=1e-12)


def test_the_robot_stands_in_mujoco(bench: ModuleType) -> None:
    model, standing = bench.settled_robot("khr3hv.sdf", FOOT, Servo(), 0.001)
    data = mujoco.MjData(model)
    data.qpos[:] = standing
    mujoco.mj_step(model, data, nstep=1000)
    assert data.qpos == pytest.approx(standing, abs=1e-4)  # m, rad
