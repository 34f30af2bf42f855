"""Robots of a user's own: a file and a model in any format stand, step, travel, or are refused."""

import json
import re
import shutil

import numpy as np
import own_robots
import pytest
from conftest import MINIMAL

from drake_gait import Candidate, Gait, WalkSettings, simulate
from drake_gait.cli.check import main as check
from drake_gait.cli.optimize import parse
from drake_gait.errors import ModelError, SettingsError
from drake_gait.foot import FootDesign
from drake_gait.gait import JOINTS, STANDING
from drake_gait.hardware.joint_log import read_joint_log
from drake_gait.optimization import open_study, try_robot
from drake_gait.report.standing import study_to_begin_with
from drake_gait.robot.description import RobotModel, read_model, servo_of
from drake_gait.robot.robot_file import default_robot, parsed, read_robot_file
from drake_gait.servo import Servo
from drake_gait.simulation.plant import build_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.servo_joints import actuators
from drake_gait.simulation.simulate import follow, measured_at_every_step, try_out
from drake_gait.simulation.stand_up import stand_up
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.robot import settings_with_robot
from drake_gait.study.store import Study
from drake_gait.study.toml import write_study_toml
from drake_gait.visualization.portraits import check_looks

MILD = Candidate(gait=Gait.from_degrees([[0, 1, 5, 0], [4, -8, 4, 0], [6, -2, 8, 0], [2, 5, 3, 0]]))
URDF, MJCF = own_robots.urdf(), own_robots.mjcf()
FILE, TOED = own_robots.urdf_toml(), own_robots.mjcf_toml()


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Files of both robots."""
    return own_robots.write(tmp_path_factory.mktemp("robots"))


@pytest.mark.parametrize("name", ["stiff", "toed"])
@pytest.mark.parametrize("how", [{}, {"sole": "points"}, {"sole": "boxes"}, {"engine": "mujoco"}])
def test_robots_of_every_format_stand_on_every_sole_and_in_both_engines(robots, name, how):
    settings = WalkSettings(model=robots[name], **how)
    walk = follow(np.zeros_like(STANDING.commands)[:], None, settings)
    assert walk.survived
    assert np.hypot(walk.forward, walk.lateral) < 0.01
    assert walk.measures.torso_tilt < np.radians(4.0)
    try_out(MILD, settings)


def test_a_robot_of_its_own_steps(robots):
    walk = simulate(MILD, WalkSettings(model=robots["toed"]), history=True)
    assert walk.survived
    assert walk.history.sole_height.max() > 0.001
    assert walk.measures.toe_range[0] > 0.02 < walk.measures.toe_range[2]
    assert walk.measures.toe_range[1] == walk.measures.toe_range[3] == 0.0


@pytest.mark.parametrize("name", ["stiff", "toed"])
def test_angles_follow_commands_in_the_signs_of_the_roles(robots, name):
    walk = simulate(MILD, WalkSettings(model=robots[name]), history=True)
    there = [role is not None for role in read_robot_file(robots[name]).joints]
    angles, commands = walk.history.angles, walk.history.commands
    assert np.isfinite(angles[:, there]).all()
    assert np.isnan(angles[:, np.logical_not(there)]).all()
    frames = slice(0, 40)  # On its feet.
    off = angles[frames, there] - commands[frames, there]
    assert np.abs(off).max() < np.radians(8.0)
    assert np.abs(commands[frames]).max() > np.radians(5.0)


def test_the_standing_pose_is_held_by_servos_and_by_welds(robots):
    stiff, toed = (build_robot(PlantConfig(model=robots[name])) for name in ("stiff", "toed"))
    assert len(stiff.joints.names) == 6
    assert "nod" not in stiff.joints.names
    plant, context = stiff.plant, stiff.plant.CreateDefaultContext()
    head = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("head")).rotation().matrix()
    assert np.degrees(np.arctan2(head[0, 2], head[2, 2])) == pytest.approx(15.0)
    assert plant.GetJointByName("right_knee").get_angle(context) == pytest.approx(-np.radians(20))
    held = [name for name, role in zip(toed.joints.names, toed.joints.roles, strict=True)
            if role < 0]  # fmt: skip
    assert held == ["right_hip_yaw", "left_hip_yaw"]
    sent = toed.joints.sent(np.ones((3, len(JOINTS))))
    assert (sent[:, [toed.joints.names.index(name) for name in held]] == 0.0).all()
    knee = toed.joints.names.index("left_knee")
    assert sent[0, knee] == pytest.approx(1.0 + np.radians(20.0))


def test_roles_and_joints_are_each_others_inverse(robots):
    joints = build_robot(PlantConfig(model=robots["toed"])).joints
    commands = np.random.default_rng(0).normal(size=(7, len(JOINTS)))
    np.testing.assert_allclose(joints.by_role(joints.sent(commands), angles=True), commands)


def test_the_soles_are_put_on_the_ground(robots):
    robot = build_robot(PlantConfig(model=robots["toed"]))  # Its pelvis is 0.4 m up in the model.
    context = robot.plant.CreateDefaultContext()
    height = robot.plant.EvalBodyPoseInWorld(context, robot.plant.GetBodyByName("pelvis"))
    assert 0.19 < height.translation()[2] < 0.22


def test_the_shipped_file_is_the_robot_that_walks_by_default():
    robot = default_robot()
    assert robot.joints == JOINTS
    assert set(robot.signs) == {1}
    assert (robot.servo, robot.standing) == (Servo(), None)
    assert read_model("khr3hv.toml") == read_model("khr3hv.sdf") == read_model()


def test_the_op3_stands_steps_and_has_a_study_to_begin_with(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stood = stand_up(WalkSettings(model="op3.toml"))
    assert stood.mass == pytest.approx(3.147, abs=1e-3)
    assert stood.com_limit == pytest.approx(read_robot_file("op3.toml").com_height, abs=1e-4)
    assert stood.touching == ()
    assert max(abs(one.torque) / one.stall for one in stood.servos) < 0.2
    (tmp_path / "op3.study.toml").write_text(study_to_begin_with(stood, "op3.toml", ""))
    assert read_study(tmp_path / "op3.study.toml").walk.model == "op3.toml"
    gait = Gait.from_degrees(
        [[0, 2.9, 9.6, 0], [16, -9.5, 7, 0], [35.3, 0, 15.6, -0.3], [19.9, 9.5, 8.7, -0.3]]
    )
    walk = simulate(Candidate(gait=gait), WalkSettings(model="op3.toml", start="shift"))
    assert walk.survived
    assert walk.forward > 0.3


def test_a_group_of_joints_has_servos_of_its_own(robots):
    own = robots["toed"].with_name("groups.toml")
    groups = (
        "[servo.knee]\nstiffness_n_m_per_rad = 40\nno_load_speed_rad_per_s = 3.74\n"
        "stall_torque_n_m = 2.5\n[servo.others]\ndamping_n_m_s_per_rad = 0.1\n"
    )
    own.write_text(f"{TOED}[servo]\nstiffness_n_m_per_rad = 20\n{groups}")
    robot = build_robot(PlantConfig(model=own, servo=Servo(stiffness=10.0)))
    for actuator in actuators(robot.plant):
        name, gains = actuator.joint().name(), actuator.get_controller_gains()
        # A study with servos half as stiff has all groups half as stiff.
        assert gains.p == pytest.approx(20.0 if "knee" in name else 10.0)
        assert gains.d == pytest.approx(0.1 if "yaw" in name else 0.2)
        assert actuator.effort_limit() == pytest.approx(2.5 if "knee" in name else 1.5)
    knees = ["knee" in name for name in robot.joints.names]
    lost = np.where(knees, 2.5 / 3.74, 1.5 / 7.48)
    np.testing.assert_allclose(robot.meter.back_emf, lost)
    dampings = [robot.plant.GetJointByName(name).default_damping() for name in robot.joints.names]
    np.testing.assert_allclose(dampings, lost)
    walk, exact = measured_at_every_step(MILD, WalkSettings(model=own, servo=Servo(stiffness=10.0)))
    assert walk.measures.peak_torque == pytest.approx(exact.peak_torque, rel=1e-6)
    assert walk.measures.energy == pytest.approx(exact.energy, rel=1e-3)
    try_out(MILD, WalkSettings(model=own, engine="mujoco", servo=Servo(load_friction=0.1)))


def test_a_log_may_name_the_joints_of_the_model(robots, tmp_path):
    log, robot = tmp_path / "log.csv", read_robot_file(robots["stiff"])
    log.write_text("time_s,right_knee,knee_l\n0,-20,5\n1,-35,7\n")
    found = read_joint_log(log, robot).angles
    np.testing.assert_allclose(np.degrees(found["knee_r"]), [0.0, 15.0])
    np.testing.assert_allclose(np.degrees(found["knee_l"]), [5.0, 7.0])
    log.write_text("time_s,hip_roll_r\n0,1\n1,1\n")
    with pytest.raises(SettingsError, match="right_hip, right_knee"):
        read_joint_log(log, robot)


def test_comments_and_names_do_not_make_another_robot(robots):
    same = parsed(f"# Mine\n{FILE}".replace('"Stiff"', '"Other"'), "a.toml")
    other = parsed(FILE.replace("nod = 15", "nod = 14"), "a.toml")
    assert same.identity == parsed(FILE, "b.toml").identity != other.identity
    before = read_model(robots["stiff"])
    changed = robots["stiff"].with_name("changed.toml")
    changed.write_text(FILE.replace("nod = 15", "nod = 14"))
    assert before != read_model(changed)


# --- Studies --------------------------------------------------------------------------------------


@pytest.fixture
def study(robots, tmp_path):
    """A study's file, and its robot's file beside it."""
    for path in robots["stiff"].parent.iterdir():
        shutil.copy(path, tmp_path)
    path = tmp_path / "study.toml"
    path.write_text(f'{MINIMAL}[robot]\nfile = "stiff.toml"\n')
    return path


def test_a_study_has_the_servos_and_the_limits_of_its_robot(study):
    settings = read_study(study)
    assert settings.walk.servo.stiffness == 30.0
    assert settings.constraints.com_height == 0.2
    other = read_study(study, {("servo", "stiffness_n_m_per_rad"): 25.0})
    assert (other.walk.servo.stiffness, other.walk.servo.damping) == (25.0, 0.2)
    assert servo_of(WalkSettings(model=study.with_name("stiff.toml"))).stiffness == 30.0


def test_a_robot_travels_in_its_study(study, tmp_path):
    settings = read_study(study)
    open_study(settings, tmp_path / "run").close()
    model = read_model(settings.walk.model)
    for name in ("stiff.toml", "stiff.urdf"):
        (tmp_path / name).unlink()
    with Study.open(tmp_path / "run") as opened:
        kept = settings_with_robot(opened).walk.model
    assert kept == model
    assert kept.robot == model.robot
    assert kept.content == URDF.encode()
    again = RobotModel.from_plain(json.loads(json.dumps(kept.plain())))
    try_out(MILD, WalkSettings(model=again.for_walks()))
    plain = kept.plain()
    with pytest.raises(ModelError, match="damaged"):
        RobotModel.from_plain({**plain, "robot": plain["robot"].replace("-20", "-21")})


def test_a_written_study_names_the_robot_again(study, tmp_path, monkeypatch):
    settings = read_study(study)
    (tmp_path / "run").mkdir()
    written = write_study_toml(settings, tmp_path / "run")
    monkeypatch.chdir("/")
    assert read_study(written).description() == settings.description()


def test_another_model_of_a_robot_is_one_override(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "heavy.urdf").write_text(URDF.replace('mass value="1.0"', 'mass value="1.1"'))
    settings = parse([str(study), "--set", "robot.model=heavy.urdf"]).settings()
    model = read_model(settings.walk.model, settings.walk.robot)
    assert b'"1.1"' in model.content
    assert model.robot == read_robot_file(tmp_path / "stiff.toml")
    try_robot(settings, model)
    (tmp_path / "run").mkdir()
    written = write_study_toml(settings, tmp_path / "run")
    assert read_study(written).description() == settings.description()


def test_an_edited_khr_3hv_is_one_override(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = read_model().content.decode()
    (tmp_path / "mine.sdf").write_text(text.replace(">1.373<", ">1.3<"))
    settings = parse([str(default_study()), "--set", "robot.model=mine.sdf"]).settings()
    model = read_model(settings.walk.model, settings.walk.robot)
    assert model.robot == default_robot()
    assert b">1.3<" in model.content
    assert settings.walk.model == str(tmp_path / "mine.sdf")


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("[design]\nbig_toe_width_mm = [10, 40]\n", "big_toe_width.*Stiff.*no \\[toes\\]"),
        ("[foot]\ntoe_length_mm = 20\n", "toe_length.*Stiff"),
        ("[foot]\nrigid_toes = true\n", "rigid_toes.*Stiff"),
        ('[walk]\nmodel = "other.toml"\n', "robot.file.*walk.model.*two robot's files"),
    ],
)
def test_a_setting_that_means_nothing_on_a_robot_is_refused(study, more, told):
    study.write_text(study.read_text() + more)
    with pytest.raises((SettingsError, ModelError), match=told):
        read_study(study)


def test_a_robot_without_a_limit_of_its_height_needs_one_in_the_study(study):
    toml = study.with_name("stiff.toml")
    toml.write_text(FILE.replace("[limits]\ncom_height_mm = 200\n", ""))
    with pytest.raises(SettingsError, match=r"com_height_mm.*check"):
        read_study(study)
    study.write_text(study.read_text() + "[constraints]\ncom_height_mm = 210\n")
    assert read_study(study).constraints.com_height == pytest.approx(0.21)


# --- The command ----------------------------------------------------------------------------------


def test_check_stands_a_robot_up_and_tells_what_a_search_needs(robots, tmp_path, capfd):
    page, study = tmp_path / "stands.html", tmp_path / "first.toml"
    assert check([str(robots["stiff"]), f"--out={page}", f"--study={study}"]) == 0
    printed = capfd.readouterr()
    assert printed.err == ""
    for told in ("2.000", "right_knee", "limits.com_height_mm", "box.centre_deg", "none"):
        assert told in printed.out
    assert page.stat().st_size > 100_000
    settings = read_study(study)
    assert settings.walk.model == str(robots["stiff"])


def test_the_how_to_s_robot_stands_and_has_a_study(repository, tmp_path, monkeypatch, capfd):
    page = (repository / "docs" / "howto" / "own_robot.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    own_robots.write(tmp_path)
    (tmp_path / "stiff.toml").write_text(text)
    (tmp_path / "heavy.urdf").write_text(URDF.replace('mass value="1.0"', 'mass value="1.1"'))
    monkeypatch.chdir(tmp_path)
    commands = re.findall(r"^    python -m (.*)$", page, re.MULTILINE)
    assert len(commands) == 3
    for command in commands:
        module, *words = command.split()
        if module == "drake_gait":
            assert words[0] == "check"
            assert check(words[1:]) == 0
        else:
            settings = parse(words).settings()
            try_robot(settings, read_model(settings.walk.model, settings.walk.robot))


# --- Robots that are refused ----------------------------------------------------------------------

STAND = "[standing_deg]\n"
BAD = {
    "no TOML": (("toml", FILE, "torso ="), "is not TOML"),
    "key of another name": (("toml", 'torso = "', 'trunk = "'), "'trunk'; the nearest is 'torso'"),
    "no torso": (("toml", 'torso = "trunk"\n', ""), "torso is missing"),
    "table that is a number": (("toml", STAND, "[x]\n"), "no key is called 'x'"),
    "torso of no name": (("toml", '"trunk"', '"chest"'), "no link 'chest'; it has trunk, head"),
    "foot of no name": (("toml", '"left_foot"', '"foot"'), "no link 'foot'; it has"),
    "no foot": (("toml", 'foot_link = "left_foot"\n', ""), "left.foot_link is missing"),
    "joint of no name": (("toml", '"left_hip"', '"hip"'), "no joint 'hip'; it has nod, right_hip"),
    "joint named twice": (
        ("toml", '"left_hip"', '"left_knee"'),
        "'left_knee' is left.hip_pitch and left.knee",
    ),
    "sign of 2": (
        ("toml", "sign = -1", "sign = 2"),
        "hip_pitch: sign must be 1 or -1, got 2",
    ),
    "sign that is text": (("toml", "sign = -1", 'sign = "-"'), "sign must be 1 or -1, got '-'"),
    "sign the other way round": (
        ("toml", '"left_hip", sign = -1', '"left_hip", sign = 1'),
        "'left_hip' is the hip_pitch of the left leg.*give it sign = -1",
    ),
    "one leg without a knee": (
        ("toml", 'knee = { joint = "left_knee", sign = -1 }\n', ""),
        "\\[right\\] has a knee and \\[left\\] has none",
    ),
    "legs exchanged": (
        ("both", "", ""),
        "right foot 'left_foot' is to the left",
    ),
    "decimal comma in the pose": (("toml", "left_knee = -20", "left_knee = -20,5"), "is not TOML"),
    "angle that is text": (
        ("toml", "left_knee = -20", 'left_knee = "20"'),
        "left_knee must be a",
    ),
    "angle beyond a turn": (("toml", "nod = 15", "nod = 400"), "standing_deg.nod.*-135 to 135"),
    "angle beyond the limits": (("toml", "nod = 15", "nod = 120"), "nod = 120 is outside.*-114"),
    "pose of no joint": (("toml", "nod = 15", "neck = 15"), "no joint 'neck'; it has"),
    "foot above the ground": (
        ("toml", "left_knee = -20", "left_knee = -70"),
        "'left_foot' is .* mm above the ground|sole of 'left_foot' is tilted by",
    ),
    "sole that is tilted": (
        ("toml", "right_ankle = 10\nleft_ankle = 10", "right_ankle = 25\nleft_ankle = 25"),
        "sole of 'right_foot' is tilted by 15.0 degrees",
    ),
    "servo of nothing": (
        ("toml", "stiffness_n_m_per_rad = 30", "stiffness_n_m_per_rad = 0"),
        "servo.stiffness_n_m_per_rad must be > 0",
    ),
    "stall torque of less than nothing": (
        ("toml", "[servo]", "[servo]\nstall_torque_n_m = -1"),
        "servo.stall_torque_n_m must be > 0 and < 10000 N·m, got -1",
    ),
    "servo of no group": (("toml", "[limits]", "[servo.hip]\n[limits]"), "'hip'; the nearest is"),
    "group of nothing": (
        ("toml", "[limits]", "[servo.knee]\nstiffness_n_m_per_rad = -1\n[limits]"),
        "servo.knee.stiffness_n_m_per_rad must be > 0",
    ),
    "fall at any height": (
        ("toml", "[limits]", "[fall]\nheight = 2\n[limits]"),
        "fall.height",
    ),
    "toes that are none": (
        ("toml", "[limits]", "[toes]\nwidth_mm = 70\n[limits]"),
        "no foot has",
    ),
    "others that hang": (("toml", '"weld"', '"hang"'), "others must be one of servo, weld, free"),
    "no such model": (("toml", "stiff.urdf", "stuff.urdf"), "there is no file .*stuff.urdf"),
    "decimal comma in a mass": (
        ("model", 'mass value="0.2"', 'mass value="0,2"'),
        "line .*0,2",
    ),
    "mass of nothing": (
        ("model", 'mass value="0.2"', 'mass value="0"'),
        "right_thigh.*<mass> must be > 0, got '0'",
    ),
    "decimal comma in a place": (("model", 'xyz="0 0 -0.05"', 'xyz="0 0 -0,05"'), "'0 0 -0,05'"),
    "two links of one name": (("model", 'link name="head"', 'link name="trunk"'), "called 'trunk'"),
    "sliding knee": (
        ("model", '"left_knee" type="revolute"', '"left_knee" type="prismatic"'),
        "'left_knee' .*must be revolute, got prismatic",
    ),
    "servo without torque": (
        ("model", 'effort="2.0"', 'effort="0"'),
        "no stall torque.*stall_torque_n_m",
    ),
    "foot of a ball": (
        ("model", '<box size="0.12 0.07 0.01"/>', '<sphere radius="0.02"/>'),
        "right_foot.*a box",
    ),
    "model of something else": (("model", URDF, "<house/>"), "begins with <house>"),
    "model of no XML": (("model", URDF, "a robot"), "not a well-formed XML"),
    "link that hangs on nothing": (
        ("model", "</robot>", '<link name="ball"/></robot>'),
        "trunk.*must float|ball",
    ),
}


@pytest.mark.parametrize(("change", "told"), BAD.values(), ids=BAD)
def test_a_bad_robot_is_one_line_that_names_value_and_cure(tmp_path, capfd, change, told):
    own_robots.write(tmp_path)
    where, old, new = change
    path = tmp_path / ("stiff.urdf" if where == "model" else "stiff.toml")
    text = path.read_text()
    if where == "both":
        text = text.replace("left_", "x_").replace("right_", "left_").replace("x_", "right_")
    assert old in text
    path.write_text(text.replace(old, new))
    assert check([str(tmp_path / "stiff.toml"), f"--out={tmp_path / 'a.html'}"]) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("error: ")
    assert printed.err.count("\n") == 1
    assert re.search(told, printed.err), printed.err


BAD_TOED = {
    "toe without a spring": (
        ("toml", ", stiffness_n_mm_per_deg = 0.8", ""),
        "toe_hinge.*no spr",
    ),
    "toe of another sense": (("toml", "big_toe", "lesser_toes"), "rename lesser_toes"),
    "spring that Drake does not read": (
        ("model", '<joint name="left_knee"', '<joint stiffness="2" name="left_knee"'),
        "'left_knee' has a stiffness",
    ),
    "motor on a toe": (
        ("model", "</actuator>", '<motor joint="left_toe_hinge"/></actuator>'),
        "'left_toe_hinge' is a toe's",
    ),
    "servos that hang free": (("toml", '"servo"', '"free"'), "'right_hip_yaw' has a servo and no"),
    "joint of another axis": (
        ("toml", '"left_hip_roll"', '"left_hip_yaw"'),
        "'left_hip_yaw' is the hip_roll of the left leg and turns about another axis",
    ),
    "roll that is exchanged": (
        ("toml", '"left_hip_roll", sign = 1', '"left_hip_roll", sign = -1'),
        "moves the foot to the left.*sign = 1",
    ),
}


@pytest.mark.parametrize(("change", "told"), BAD_TOED.values(), ids=BAD_TOED)
def test_a_bad_robot_with_toes_is_one_line_too(tmp_path, change, told):
    own_robots.write(tmp_path)
    where, old, new = change
    path = tmp_path / ("toed.xml" if where == "model" else "toed.toml")
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ModelError, match=told) as refusal:
        try_out(MILD, WalkSettings(model=tmp_path / "toed.toml"))
    assert "\n" not in str(refusal.value)


def test_a_foot_design_changes_nothing_on_a_robot_whose_toes_are_not_designed(robots):
    settings = WalkSettings(model=robots["toed"])
    wide = FootDesign(big_toe_width=0.03, big_toe_stiffness=0.1)
    walks = [simulate(Candidate(gait=MILD.gait, foot=foot), settings)
             for foot in (FootDesign(), wide)]  # fmt: skip
    assert walks[0].forward == walks[1].forward


CUBE = "".join(
    f"v {x} {y} {z}\n" for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (-0.02, 0.02)
) + "".join(
    f"f {face}\n"
    for face in (
        *("1 2 4", "1 4 3", "5 7 8", "5 8 6", "1 5 6", "1 6 2"),
        *("3 4 8", "3 8 7", "1 3 7", "1 7 5", "2 6 8", "2 8 4"),
    )
)
MESH = '<geometry><mesh filename="{}"/></geometry>'
MESHES = {
    "URDF, beside": (
        "stiff.urdf",
        '<link name="head">',
        f'<link name="head"><visual>{MESH.format("meshes/cube.obj")}</visual>',
    ),
    "URDF, in a package": (
        "stiff.urdf",
        '<link name="head">',
        f'<link name="head"><collision>{MESH.format("package://mine/meshes/cube.obj")}</collision>',
    ),
    "MJCF, in its folder": (
        "toed.xml",
        'autolimits="true"/>',
        'autolimits="true" meshdir="meshes"/><asset><mesh name="cube" file="cube.obj"/></asset>',
    ),
}


@pytest.mark.parametrize(("name", "old", "new"), MESHES.values(), ids=MESHES)
def test_meshes_of_every_format_travel_with_the_robot(tmp_path, name, old, new):
    folder = tmp_path / "mine"
    own_robots.write(folder)
    (folder / "meshes").mkdir()
    (folder / "meshes" / "cube.obj").write_text(CUBE)
    text = (folder / name).read_text().replace(old, new)
    if name == "toed.xml":
        geom = '<geom type="mesh" mesh="cube" pos="0 0 0.15"/>'
        text = text.replace('<site name="imu"/>', geom)
    (folder / name).write_text(text)
    model = read_model((folder / name).with_suffix(".toml"))
    assert [file.path for file in model.files] == ["cube.obj"]
    kept = RobotModel.from_plain(json.loads(json.dumps(model.plain())))
    shutil.rmtree(folder)
    try_out(MILD, WalkSettings(model=kept.for_walks()))
    check_looks(kept, FootDesign())
    (kept_file,) = kept.files
    assert kept_file.content == CUBE.encode()
