"""The robot in MuJoCo is the robot in Drake, as far as both can say it."""

import dataclasses
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from drake_gait.errors import ModelError, SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import FRAMES, JOINTS, Gait
from drake_gait.problem import Candidate
from drake_gait.robot.description import models_folder, read_model
from drake_gait.robot.robot_file import default_robot
from drake_gait.servo import Servo
from drake_gait.simulation import simulate as seam
from drake_gait.simulation.command_source import desired_state
from drake_gait.simulation.mujoco import engine
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.simulate import follow, simulate, try_out
from drake_gait.sole import Contact, Sole
from drake_gait.study.reading import default_study, read_study
from drake_gait.walk import Disturbance, Engine, Fidelity, Integrator, Outcome, WalkSettings

WALKING = Candidate(gait=read_study(default_study()).space.decode(np.zeros(16)).gait)
FALLING = Candidate(gait=Gait.from_degrees([[15, 0, 0, 0], [40, 0, 0, 0], [0] * 4, [0] * 4]))
IN_MUJOCO = WalkSettings(engine=Engine.MUJOCO, sole=Sole.POINTS)
FOOT = FootDesign(  # Nothing of it is the default.
    big_toe_stiffness=0.05, lesser_toes_stiffness=0.02, toe_damping=1e-3, big_toe_width=0.030,
    toe_length=0.020,
)  # fmt: skip
RIGID = FootDesign(rigid_toes=True)
STANDING = np.zeros((FRAMES + 1, len(JOINTS)))


def compiled(foot=FOOT, sole=Sole.POINTS, mass=1.0, **changes):
    """The robot in MuJoCo, and in Drake."""
    config = PlantConfig(model=read_model("khr3hv.sdf"), foot=foot, sole=sole, **changes)
    return engine._model(config, 0.001, mass)


def anywhere(found, seed=0):
    """A state of MuJoCo's, far from the ground, with the same state in Drake."""
    rng, data = np.random.default_rng(seed), mujoco.MjData(found.model)
    data.qpos[:] = rng.uniform(0.05, 0.5, found.model.nq)
    data.qpos[:3] = rng.uniform(1.0, 2.0, 3)
    data.qpos[3:7] = RollPitchYaw(rng.uniform(-1.0, 1.0, 3)).ToQuaternion().wxyz()
    data.qvel[:] = rng.uniform(-1.0, 1.0, found.model.nv)
    context = found.show(0.0, data.qpos, data.qvel)
    mujoco.mj_forward(found.model, data)
    return data, found.robot.plant.GetMyContextFromRoot(context)


def as_in_drake(found, data, values):
    """Rows of MuJoCo's velocities or forces in the order and the axes of Drake's."""
    turned = np.array(values)
    turned[3:6] = data.body("torso").xmat.reshape(3, 3) @ turned[3:6]
    return turned[found.velocities]


@pytest.mark.parametrize("foot", [FOOT, RIGID], ids=["toes", "rigid toes"])
def test_masses_and_inertias_agree_with_drake_to_rounding(foot):
    found = compiled(foot)
    data, context = anywhere(found)
    inertia = np.zeros((found.model.nv, found.model.nv))
    for column, unit in zip(inertia, np.eye(found.model.nv), strict=True):
        mujoco.mj_mulM(found.model, data, column, unit)
    inertia = as_in_drake(found, data, as_in_drake(found, data, inertia).T)
    expected = found.robot.plant.CalcMassMatrix(context)
    np.testing.assert_allclose(inertia, expected, atol=1e-12)


@pytest.mark.parametrize("foot", [FOOT, RIGID], ids=["toes", "rigid toes"])
def test_gravity_and_the_forces_of_motion_agree_with_drake_to_rounding(foot):
    found = compiled(foot)
    data, context = anywhere(found)
    plant = found.robot.plant
    expected = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(as_in_drake(found, data, data.qfrc_bias), expected, atol=1e-12)


def test_a_robot_in_free_fall_falls_as_everything_does():
    found = compiled()
    data, _ = anywhere(found)
    mujoco.mj_subtreeVel(found.model, data)
    before = data.subtree_linvel[1].copy()
    mujoco.mj_step(found.model, data, nstep=100)
    mujoco.mj_forward(found.model, data)
    mujoco.mj_subtreeVel(found.model, data)
    assert data.ncon == 0
    np.testing.assert_allclose(data.subtree_linvel[1] - before, [0.0, 0.0, -0.981], atol=1e-3)


def test_a_posture_puts_every_link_where_drake_puts_it():
    found = compiled()
    data, context = anywhere(found)
    plant = found.robot.plant
    for index in plant.GetBodyIndices(plant.GetBodyByName("torso").model_instance()):
        body = plant.get_body(index)
        X_WB = plant.EvalBodyPoseInWorld(context, body)
        np.testing.assert_allclose(data.body(body.name()).xpos, X_WB.translation(), atol=1e-12)
        rotation = data.body(body.name()).xmat.reshape(3, 3)
        np.testing.assert_allclose(rotation, X_WB.rotation().matrix(), atol=1e-12)


@pytest.mark.parametrize(("error", "speed"), [(0.03, 1.0), (0.5, 3.0), (-0.5, 7.48)])
@pytest.mark.parametrize("voltage", [1.0, 0.9])
def test_a_servo_pulls_along_the_torque_speed_line(error, speed, voltage):
    found, servo = compiled(voltage=voltage), Servo()
    data = mujoco.MjData(found.model)
    data.actuator(JOINTS.index("knee_l")).ctrl[:] = error
    data.joint("knee_l").qvel[:] = speed
    mujoco.mj_forward(found.model, data)
    torque = data.joint("knee_l").qfrc_actuator + data.joint("knee_l").qfrc_passive
    stall = 1.373 * voltage
    controlled = np.clip(servo.stiffness * error - servo.damping * speed, -stall, stall)
    assert torque == pytest.approx(controlled - stall * speed / (voltage * servo.no_load_speed))


def test_a_toe_presses_with_what_its_spring_and_its_damper_give():
    found = compiled()
    data = mujoco.MjData(found.model)
    for hinge, stiffness in zip(default_robot().hinges, 2 * (0.05, 0.02), strict=True):
        data.joint(hinge).qpos[:], data.joint(hinge).qvel[:] = 0.3, 2.0
        mujoco.mj_forward(found.model, data)
        assert data.joint(hinge).qfrc_passive == pytest.approx(-0.3 * stiffness - 2.0 * 1e-3)


def test_a_toe_stops_where_it_stops_in_drake():
    found = compiled()
    hinge = found.robot.plant.GetJointByName(default_robot().hinges[0])
    stops = [hinge.position_lower_limits()[0], hinge.position_upper_limits()[0]]
    assert found.model.joint(default_robot().hinges[0]).range == pytest.approx(stops)
    assert found.model.jnt_limited[found.model.joint(default_robot().hinges[0]).id]
    assert not found.model.jnt_limited[found.model.joint("knee_l").id]


@pytest.mark.parametrize("sole", list(Sole))
def test_a_standing_robot_presses_on_the_ground_with_its_weight(sole):
    walk = follow(STANDING, settings=dataclasses.replace(IN_MUJOCO, sole=sole), history=True)
    assert walk.outcome is Outcome.WALKED
    assert walk.history.ground_reaction[-1, :, 2].sum() == pytest.approx(1.5 * 9.81, rel=1e-3)
    assert abs(walk.forward) + abs(walk.lateral) < 2e-3
    assert walk.measures.positive_energy < 0.1
    assert walk.measures.duty_factor == (1.0, 1.0)
    assert max(walk.measures.slip) < 1e-3


def test_a_standing_robot_sinks_as_deep_as_in_drake():
    depths = []
    for one in Engine:
        settings = dataclasses.replace(IN_MUJOCO, engine=one)
        walk = follow(STANDING, settings=settings, history=True)
        depths.append(-walk.history.sole_height[-1])
    assert depths[1] == pytest.approx(depths[0], rel=0.1)
    assert depths[1].max() > 1e-4  # m


@pytest.mark.parametrize("sole", [Sole.POINTS, Sole.AREA])
def test_a_plate_that_bears_the_weight_is_damped_as_in_drake(sole):
    # Hunt and Crossley's damping is dissipation x force.
    found = compiled(sole=sole)
    model, plant = found.model, found.robot.plant
    weight = plant.CalcTotalMass(plant.CreateDefaultContext()) * 9.81
    damping = {}
    for pair in np.flatnonzero(model.pair_solref[:, 0] < 0.0):
        bodies = model.geom_bodyid[[model.pair_geom1[pair], model.pair_geom2[pair]]]
        # f = D (a_ref - a) with D = impedance / (1 - impedance) / lightness.
        lightness, impedance = model.body_invweight0[bodies, 0].sum(), model.pair_solimp[pair, 0]
        inertia = impedance / (1.0 - impedance) / lightness
        plate = int(bodies.max())
        damping.setdefault(plate, []).append(-inertia * model.pair_solref[pair, 1] / impedance)
    assert len(damping) == 6
    expected = pytest.approx(Contact().dissipation * weight, rel=0.01)
    assert [sum(of_plate) for of_plate in damping.values()] == [expected] * 6


def test_points_are_where_drake_has_them_and_area_is_the_vertices_of_its_rim():
    points, area = compiled(), compiled(sole=Sole.AREA)
    inspector = points.robot.scene_graph.model_inspector()
    in_drake = {
        tuple(np.round(inspector.GetPoseInFrame(one).translation(), 9))
        for one in inspector.GetAllGeometryIds()
        if "_sole_" in inspector.GetName(one)
    }
    feet = [geom for geom in range(points.model.ngeom)
            if points.model.geom(geom).type == mujoco.mjtGeom.mjGEOM_SPHERE]  # fmt: skip
    assert {tuple(np.round(points.model.geom_pos[geom], 9)) for geom in feet} == in_drake
    corners = {tuple(np.round(points.model.geom_pos[geom][:2], 9)) for geom in feet}
    assert corners < {tuple(np.round(pos[:2], 9)) for pos in area.model.geom_pos}


def test_pairs_have_the_kinetic_friction_that_drake_combines():
    own, sticky = (compiled(friction=factor).model.pair_friction[:, 0] for factor in (1.0, 1.1))
    # The heel's, the toes', and that of the shins' boxes: table of docs/explanation/robot.md.
    assert set(np.round(own, 6)) == {0.417, 0.155, 0.461538}
    np.testing.assert_allclose(sticky, 1.1 * own, rtol=1e-9)


def test_a_disturbance_changes_the_model_as_it_changes_drake_s():
    own, heavy = compiled().model, compiled(mass=1.03).model
    assert heavy.body_mass == pytest.approx(1.03 * own.body_mass)
    assert heavy.body_inertia == pytest.approx(1.03 * own.body_inertia)
    zeros = (0.01, *(0.0,) * 9)
    disturbed = dataclasses.replace(IN_MUJOCO, disturbance=Disturbance(joint_zeros=zeros))
    found, same = follow(STANDING, settings=disturbed), follow(STANDING + zeros, settings=IN_MUJOCO)
    assert (found.forward, found.lateral, found.yaw) == (same.forward, same.lateral, same.yaw)


def test_servos_are_sent_the_commands_that_drake_sends():
    commands = WALKING.gait.commands
    sent = engine._in_steps(commands, 0.001).reshape(-1, len(JOINTS))
    expected = [desired_state(commands, 0.001 * step)[:10] for step in range(len(sent))]
    np.testing.assert_allclose(sent, expected, atol=1e-12)


def test_late_servos_are_sent_what_drake_sends_late():
    commands = WALKING.gait.commands
    sent = engine._in_steps(commands, 0.001, 0.013).reshape(-1, len(JOINTS))
    expected = [desired_state(commands, 0.001 * step - 0.013)[:10] for step in range(len(sent))]
    np.testing.assert_allclose(sent, expected, atol=1e-12)


def test_friction_and_play_of_servos_are_those_of_drake():
    servo = Servo(coulomb_friction=0.03, load_friction=0.2, backlash=0.02)
    found = compiled(servo=servo)
    data, servos = mujoco.MjData(found.model), engine._Servos(found)
    joints = [found.model.joint(name).dofadr[0] for name in JOINTS]
    assert found.model.dof_frictionloss[joints] == pytest.approx(0.03)
    command = np.array([0.0, 0.005, 0.03, -0.03, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    servos.follow(data, command)
    np.testing.assert_allclose(data.ctrl[:4], [0.0, 0.0, 0.02, -0.02], atol=1e-12)
    motor = np.minimum(servo.stiffness * np.abs(data.ctrl), 1.373)
    np.testing.assert_allclose(found.model.dof_frictionloss[joints], 0.03 + 0.2 * motor)
    # The next walk in the same model begins with its own.
    engine._Servos(found)
    assert found.model.dof_frictionloss[joints] == pytest.approx(0.03)
    assert not compiled().model.dof_frictionloss.any()


def test_a_gait_walks_in_both_engines_and_about_as_far():
    walk = simulate(WALKING, IN_MUJOCO, history=True)
    own = simulate(WALKING, dataclasses.replace(IN_MUJOCO, engine=Engine.DRAKE))
    assert walk.outcome is own.outcome is Outcome.WALKED
    assert walk.forward == pytest.approx(own.forward, rel=0.15)
    assert walk.com_height == pytest.approx(own.com_height, abs=2e-3)
    assert walk.history.positions.shape == (FRAMES + 1, 21)
    assert walk.history.com[-1, 0] - walk.history.com[0, 0] == pytest.approx(walk.forward)
    assert 0.0 < walk.measures.duty_factor[0] < 1.0
    assert 0.0 < walk.measures.positive_energy < walk.measures.energy


def test_looking_at_a_walk_does_not_change_it_and_every_frame_is_told():
    seen = []
    watched = simulate(
        FALLING, IN_MUJOCO, history=True, watch=lambda time, positions: seen.append(time)
    )
    own = simulate(FALLING, IN_MUJOCO)
    assert watched.outcome is own.outcome is Outcome.FELL
    assert (watched.forward, watched.yaw, watched.frames) == (own.forward, own.yaw, own.frames)
    assert len(seen) == own.frames + 1 == len(watched.history.time) - 1
    assert own.history is None


def test_a_walk_is_the_same_bit_for_bit_in_another_process():
    code = (
        "from drake_gait.simulation.simulate import follow\n"
        "from drake_gait.walk import WalkSettings\n"
        "import numpy as np\n"
        "commands = 0.1 * np.sin(np.arange(241.0))[:, None] * np.ones(10)\n"
        "walk = follow(commands, settings=WalkSettings(engine='mujoco'))\n"
        "print(repr((walk.frames, walk.forward, walk.lateral, walk.yaw, walk.com_height)))\n"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    commands = 0.1 * np.sin(np.arange(241.0))[:, None] * np.ones(10)
    walk = follow(commands, settings=WalkSettings(engine="mujoco"))
    own = (walk.frames, walk.forward, walk.lateral, walk.yaw, walk.com_height)
    assert told.stdout.strip() == repr(own)


def test_steps_are_of_1_ms_at_both_fidelities_or_finer_where_the_study_says_so():
    for fidelity in Fidelity:
        settings = WalkSettings(engine="mujoco", fidelity=fidelity)
        assert settings.stepping == Integrator(step=0.001)
    assert WalkSettings(engine="mujoco", step=0.0005).stepping.step == pytest.approx(0.0005)


@pytest.mark.parametrize("how", [{"accuracy": 1e-3}, {"discrete": True}])
def test_drake_s_own_integrators_are_refused_in_mujoco(how):
    with pytest.raises(SettingsError, match=r"integrator.*MuJoCo"):
        WalkSettings(engine="mujoco", integrator=Integrator(step=0.001, **how))


def test_without_mujoco_one_line_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(seam, "find_spec", lambda name: None)
    with pytest.raises(SettingsError, match=r"walk\.engine.*pip install 'drake-gait\[mujoco\]'"):
        simulate(WALKING, IN_MUJOCO)


def test_a_robot_is_tried_out_in_the_engine_that_is_to_walk_it(monkeypatch):
    monkeypatch.setattr(seam, "prepare", None)
    try_out(WALKING, IN_MUJOCO)


def test_a_state_that_is_no_number_ends_a_walk_as_diverged(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    raw = engine._standing
    monkeypatch.setattr(engine, "_standing", lambda *args, **more: raw(*args, **more) * np.nan)
    walk = simulate(WALKING, IN_MUJOCO)
    assert walk.outcome is Outcome.DIVERGED
    assert walk.failure == "solver"
    assert list(tmp_path.iterdir()) == []  # MuJoCo writes a log otherwise.


SOFT = "<drake:compliant_hydroelastic />"
MESHED = f"{SOFT}<drake:mesh_resolution_hint>0.02</drake:mesh_resolution_hint>"


def own_robot(tmp_path, old, new):
    """The shipped robot with other text in its file, as a model of MuJoCo."""
    text = (models_folder() / "khr3hv.sdf").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "mine.sdf"
    path.write_text(text.replace(old, new).replace(SOFT, MESHED), encoding="utf-8")
    return engine._model(PlantConfig(model=read_model(path), sole=Sole.POINTS), 0.001).model


SHIN = "<box>\n            <size>0.038 0.03 0.038</size>\n          </box>"


@pytest.mark.parametrize(
    ("shape", "kind", "sizes"),
    [
        ("<sphere><radius>0.02</radius></sphere>", "SPHERE", [0.02]),
        ("<cylinder><radius>0.02</radius><length>0.03</length></cylinder>", "CYLINDER",
         [0.02, 0.015]),
        ("<capsule><radius>0.02</radius><length>0.03</length></capsule>", "CAPSULE", [0.02, 0.015]),
        ("<ellipsoid><radii>0.02 0.015 0.01</radii></ellipsoid>", "ELLIPSOID", [0.02, 0.015, 0.01]),
    ],
)  # fmt: skip
def test_shapes_of_an_own_robot_are_the_same_shapes_in_mujoco(tmp_path, shape, kind, sizes):
    model = own_robot(tmp_path, SHIN, shape)
    shins = np.flatnonzero(model.geom_bodyid == model.body("shin_r").id)
    assert [model.geom_type[geom] for geom in shins] == [getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")]
    assert model.geom_size[shins[0], : len(sizes)] == pytest.approx(sizes)
    assert any(shins[0] in pair for pair in zip(model.pair_geom1, model.pair_geom2, strict=True))


PAYLOAD = """<link name="payload"><pose relative_to="torso">0 0 0.2 0 0 0</pose><inertial>
<mass>0.05</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia></inertial></link>
<joint name="mount" type="{kind}"><parent>torso</parent><child>payload</child>{axis}</joint>
</model>"""
AXIS = """<axis><xyz>0 0 1</xyz><limit><lower>-0.01</lower><effort>0</effort></limit>
<dynamics><damping>3</damping></dynamics></axis>"""


def test_a_payload_that_slides_slides_in_mujoco_with_the_stop_that_it_has(tmp_path):
    model = own_robot(tmp_path, "</model>", PAYLOAD.format(kind="prismatic", axis=AXIS))
    mount = model.joint("mount")
    assert mount.type == mujoco.mjtJoint.mjJNT_SLIDE
    assert model.dof_damping[mount.dofadr[0]] == 3.0
    assert mount.range[0] == pytest.approx(-0.01)
    assert mount.range[1] > 100.0
    assert model.body_mass.sum() == pytest.approx(1.55)


def test_what_is_bolted_to_a_link_weighs_and_moves_with_it(tmp_path):
    model = own_robot(tmp_path, "</model>", PAYLOAD.format(kind="fixed", axis=""))
    assert model.body_mass.sum() == pytest.approx(1.55)
    assert model.nv == 20


def test_a_joint_that_mujoco_has_no_word_for_is_refused_by_its_name(tmp_path):
    with pytest.raises(ModelError, match=r"mine\.sdf: joint 'mount' is ball.*MuJoCo"):
        own_robot(tmp_path, "</model>", PAYLOAD.format(kind="ball", axis=""))
