"""Changes of the robot in tier 3 reach the plants of both engines, one by one."""

import dataclasses

import numpy as np
import pytest

from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, JOINTS
from drake_gait.search.confirmation import other_servo
from drake_gait.simulation.command_source import commands_at
from drake_gait.simulation.mujoco import engine as mujoco_engine
from drake_gait.simulation.simulate import prepare
from drake_gait.study.finalists import Tier
from drake_gait.study.search_settings import ConfirmationSettings
from drake_gait.walk import Engine, Fidelity

RANGES = {
    "joint_zero": 0.02,
    "servo_stiffness": 0.1,
    "supply_voltage": 0.1,
    "mass": 0.03,
    "command_delay": 0.03,
    "integrator_step": 0.5,
}
TIMES = FRAME_TIME * np.arange(10, 200)
COMMANDS = np.cumsum(np.random.default_rng(1).uniform(-0.02, 0.02, (241, 10)), axis=0)


def in_drake(how):
    """What a robot in Drake is made of, and what its servos follow."""
    robot, context = prepare(COMMANDS, FootDesign(), how)
    plant = robot.plant
    plant_context = plant.GetMyContextFromRoot(context)
    actuators = [plant.GetJointActuatorByName(name) for name in JOINTS]
    joints = [plant.GetJointByName(name) for name in JOINTS]
    bodies = plant.GetBodyIndices(joints[0].model_instance())
    gait_context = robot.gait.GetMyMutableContextFromRoot(context)
    followed = []
    for time in TIMES:
        # Commands are read at the beginning of the step at whose end they count.
        context.SetTime(time - how.stepping.lead)
        followed.append(robot.gait.GetOutputPort("desired_state").Eval(gait_context)[:10])
    return {
        "stiffness": [one.get_controller_gains().p for one in actuators],
        "controller damping": [one.get_controller_gains().d for one in actuators],
        "stall torque": [one.effort_limit() for one in actuators],
        "back-EMF": [one.GetDampingVector(plant_context)[0] for one in joints],
        "rotors": [one.calc_reflected_inertia(plant_context) for one in actuators],
        "inertia": [
            plant.get_body(index).CalcSpatialInertiaInBodyFrame(plant_context).CopyToFullMatrix6()
            for index in bodies
        ],
        "commands": followed,
        "step": how.stepping.step,
    }


def in_mujoco(how):
    """The same in MuJoCo."""
    ready = mujoco_engine.prepare(COMMANDS, FootDesign(), how)
    model = ready.model.model
    dofs = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    return {
        "stiffness": model.actuator_gainprm[:, 0],
        "controller damping": -model.actuator_biasprm[:, 2],
        "stall torque": model.actuator_forcerange[:, 1],
        "back-EMF": model.dof_damping[dofs],
        "rotors": model.dof_armature[dofs],
        "inertia": np.hstack([model.body_mass[:, None], model.body_inertia]),
        "commands": ready.targets[10:200, 0],
        "step": model.opt.timestep,
    }


@pytest.fixture(scope="module", params=[in_drake, in_mujoco], ids=["drake", "mujoco"])
def plants(request, study):
    """A study's robot as it is, and with each change of the robot alone."""
    engine = Engine.MUJOCO if request.param is in_mujoco else Engine.DRAKE
    walk = dataclasses.replace(study.walk, engine=engine, fidelity=Fidelity.REFERENCE)
    none = ConfirmationSettings(**dict.fromkeys(RANGES, 0.0))
    number = Tier.SERVO.variations(none).start

    def found(**ranges):
        plan = dataclasses.replace(none, **ranges)
        settings = dataclasses.replace(study, walk=walk, confirmation=plan)
        how = other_servo(settings, walk, 7, number)
        built = request.param(how)
        return how, {name: np.asarray(value) for name, value in built.items()}

    return found()[1], {name: found(**{name: most}) for name, most in RANGES.items()}


def changed(plants, name):
    """What a change alters, by name, with the settings it comes from."""
    usual, others = plants
    how, built = others[name]
    return how, {
        part: (usual[part], value)
        for part, value in built.items()
        if not np.allclose(value, usual[part], rtol=1e-12, atol=1e-12)
    }


def assert_scaled(pair, most, rel=1e-9):
    """One factor within its range, the same for all numbers."""
    usual, value = (np.asarray(one) for one in pair)
    factor = value[usual != 0.0] / usual[usual != 0.0]
    assert 0.0 < abs(factor.flat[0] - 1.0) <= most
    np.testing.assert_allclose(value, factor.flat[0] * usual, rtol=rel)


@pytest.mark.parametrize(("name", "part"), [("servo_stiffness", "stiffness"), ("mass", "inertia")])
def test_stiffness_and_mass_scale_alone(plants, name, part):
    _, found = changed(plants, name)
    assert set(found) == {part}
    assert_scaled(found[part], RANGES[name])


def test_the_supply_scales_the_stall_torque_and_once_the_no_load_speed(plants):
    # The no-load speed is stall torque / back-EMF per speed: the latter stays.
    how, found = changed(plants, "supply_voltage")
    assert set(found) == {"stall torque"}
    assert_scaled(found["stall torque"], RANGES["supply_voltage"])
    usual, value = found["stall torque"]
    np.testing.assert_allclose(value, how.disturbance.voltage * usual, rtol=1e-12)


def test_zeros_displace_every_command_of_a_joint_evenly(plants):
    _, found = changed(plants, "joint_zero")
    assert set(found) == {"commands"}
    shift = np.subtract(*reversed(found["commands"]))
    np.testing.assert_allclose(shift, np.tile(shift[0], (len(shift), 1)), atol=1e-12)
    assert len(set(shift[0].tolist())) == len(JOINTS)
    assert np.abs(shift).max() <= RANGES["joint_zero"]


def test_a_delay_makes_every_command_late(plants):
    how, found = changed(plants, "command_delay")
    assert set(found) == {"commands"}
    late = how.disturbance.delay
    assert 0.0 < late <= RANGES["command_delay"]
    np.testing.assert_allclose(found["commands"][1], commands_at(COMMANDS, TIMES - late), atol=1e-9)


def test_finer_steps_change_the_step_alone(plants):
    _, found = changed(plants, "integrator_step")
    assert set(found) == {"step"}
    usual, value = found["step"]
    assert 0.5 * usual <= value < usual
