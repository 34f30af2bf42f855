"""A robot file walks as Drake reads it, or is refused in one line before a study is begun."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from drake_gait import Candidate, FootDesign, WalkSettings, simulate
from drake_gait.cli.optimize import main
from drake_gait.errors import ModelError, SettingsError
from drake_gait.robot.description import RobotModel, located, model_path, models_folder, read_model
from drake_gait.robot.robot_file import default_robot
from drake_gait.servo import Servo
from drake_gait.simulation.contact import GROUND_FRICTION
from drake_gait.simulation.plant import add_robot, build_robot
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.simulate import try_out
from drake_gait.study.reading import default_study, read_study
from drake_gait.visualization.portraits import check_looks

TEXT = model_path().read_text(encoding="utf-8")
WALKING = Candidate(gait=read_study(default_study()).space.decode(np.zeros(16)).gait)
FRICTION = re.compile(r"\s*<drake:mu_\w+>[^<]*</drake:mu_\w+>")
INERTIA = "<inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia>"
INERTIAL = f"<inertial><mass>0.01</mass>{INERTIA}</inertial>"
ODE = "<surface><friction><ode>{}</ode></friction></surface></collision>"


def inside(kind, name, old, new):
    """The robot, with something else in one of its links or joints."""
    begin = TEXT.index(f'<{kind} name="{name}"')
    end = TEXT.index(f"</{kind}>", begin)
    part = TEXT[begin:end]
    assert re.search(old, part), old
    return TEXT[:begin] + re.sub(old, new, part, count=1) + TEXT[end:]


def with_more(element):
    return TEXT.replace("</model>", f"{element}</model>")


def in_torso(element):
    return TEXT.replace('<link name="torso">', f'<link name="torso">{element}')


def with_mesh(uri, kind="visual", inner=""):
    return in_torso(
        f'<{kind} name="of_mesh"><pose>0 0 0.2 0 0 0</pose>'
        f"<geometry><mesh>{inner}<uri>{uri}</uri></mesh></geometry></{kind}>"
    )


SECOND = (
    "<collision name='more'><geometry><box><size>.01 .01 .005</size></box></geometry>"
    "<drake:proximity_properties><drake:compliant_hydroelastic/>"
    "<drake:hydroelastic_modulus>1e6</drake:hydroelastic_modulus></drake:proximity_properties>"
    "</collision>"
)
BOX = r"<box>\s*<size>[^<]*</size>\s*</box>"
BAD = {
    # Numbers of which Drake takes the beginning, or a default.
    "comma in a mass": (inside("link", "torso", r"<mass>1\.", "<mass>1,"), "torso.*<mass>.*'1,03"),
    "comma in a place": (inside("link", "thigh_l", r"<pose>0\.", "<pose>0,"), "thigh_l.*<pose>"),
    "comma in a size": (inside("link", "shin_l", r"<size>0\.", "<size>0,"), "shin_l.*<size>"),
    "comma in a spring": (
        inside("joint", "big_toe_hinge_l", "stiffness>0.", "stiffness>0,"),
        "big_toe_hinge_l.*<spring_stiffness>.*'0,02",
    ),
    "comma in a colour": (TEXT.replace("<diffuse>0.93", "<diffuse>0,93"), "<diffuse>.*'0,93"),
    "unit in an effort": (inside("joint", "knee_l", "1.373", "1.373 N m"), "knee_l.*'1.373 N m'"),
    "comma in an effort": (inside("joint", "knee_l", "1.373", "1,4"), "knee_l.*<effort>.*'1,4'"),
    "digits of another script": (inside("link", "shin_l", r"<mass>0", "<mass>٣"), "<mass>.*'٣"),
    "underscore in a mass": (inside("link", "hip_l", "<mass>0.", "<mass>0.0_"), "hip_l.*<mass>"),
    "empty mass": (inside("link", "hip_l", "<mass>[^<]*", "<mass>"), "hip_l.*<mass>.*''"),
    "a mass that is infinite": (inside("link", "hip_l", "<mass>[^<]*", "<mass>inf"), "'inf'"),
    "pose of five numbers": (inside("link", "hip_l", "<pose>[^<]*", "<pose>0 0 0 0 0"), "<pose>"),
    "no mass": (inside("link", "hip_l", "<mass>[^<]*</mass>", ""), "hip_l.*inertial/mass.*1 kg"),
    "no moment": (inside("link", "hip_l", "<iyy>[^<]*</iyy>", ""), "hip_l.*inertia/iyy"),
    # Numbers that no robot has.
    "negative mass": (inside("link", "thigh_l", "<mass>", "<mass>-"), "thigh_l.*<mass>.*> 0.*-0"),
    "size of nothing": (inside("link", "shin_l", r"<size>\S+", "<size>0"), "shin_l.*<size>.*> 0"),
    "inertia of no body": (
        inside("link", "thigh_l", "<ixx>[^<]*", "<ixx>3"),
        "line [0-9]+: link 'thigh_l': <inertia>",
    ),
    "axis of no direction": (inside("joint", "knee_l", "<xyz>[^<]*", "<xyz>0 0 0"), "knee_l.*xyz"),
    "spring that pushes": (
        inside("joint", "lesser_toes_hinge_r", "stiffness>", "stiffness>-"),
        "lesser_toes_hinge_r.*<spring_stiffness> must be >= 0",
    ),
    "rotor of less than nothing": (
        inside("joint", "knee_r", "<drake:rotor_inertia>", "<drake:rotor_inertia>-"),
        "knee_r.*rotor_inertia",
    ),
    "soft as nothing": (TEXT.replace("modulus>1000000", "modulus>0"), "hydroelastic_modulus.*> 0"),
    # Servos and toes.
    "no effort": (
        inside("joint", "ankle_roll_l", "<effort>[^<]*</effort>", ""),
        "ankle_roll_l.*<effort>.*got none",
    ),
    "negative effort": (
        inside("joint", "hip_roll_r", "<effort>", "<effort>-"),
        "hip_roll_r.*-1.37",
    ),
    "no torque": (inside("joint", "hip_roll_r", "1.373", "0"), "hip_roll_r.*<effort>.*got 0"),
    "endless torque": (inside("joint", "hip_roll_r", "1.373", "inf"), "hip_roll_r.*got inf"),
    "toe with a servo": (
        inside("joint", "big_toe_hinge_r", "<effort>0", "<effort>2"),
        "big_toe_hinge_r.*<effort> must be 0.*got 2",
    ),
    "toe without a spring": (
        inside("joint", "big_toe_hinge_r", "<spring_stiffness>[^<]*</spring_stiffness>", ""),
        "big_toe_hinge_r.*no spring",
    ),
    "sliding knee": (inside("joint", "knee_r", '"revolute"', '"prismatic"'), "knee_r.*prismatic"),
    "gains": (
        inside("joint", "knee_r", "</axis>", "</axis><drake:controller_gains p='1' d='1'/>"),
        r"knee_r.*controller_gains.*\[servo\]",
    ),
    # Friction.
    "negative friction": (
        inside("link", "foot_l", "<drake:mu_dynamic>", "<drake:mu_dynamic>-"),
        "foot_l.*<drake:mu_dynamic>.*>= 0",
    ),
    "friction that is none": (
        inside("link", "foot_l", "(<drake:mu_static>)[^<]*", r"\1nan"),
        "foot_l.*<drake:mu_static>.*'nan'",
    ),
    "friction that grows with speed": (
        inside("link", "foot_l", "(<drake:mu_static>)[^<]*", r"\g<1>0.1"),
        "foot_l.*dynamic friction.*0.26.* and 0.1",
    ),
    "friction with a comma": (
        FRICTION.sub("", TEXT).replace("</collision>", ODE.format("<mu>0,5</mu>")),
        "<mu>.*'0,5'",
    ),
    "friction of glue": (
        re.sub(r"(<drake:mu_\w+>)[^<]*", r"\g<1>60", TEXT),
        r"1\.1 times the friction.*60.*walk\.friction",
    ),
    # Links and joints.
    **{
        f"no {name}": (
            TEXT.replace(f'name="{name}"', 'name="other"').replace(f">{name}<", ">other<"),
            f"no link '{name}'",
        )
        for name in default_robot().links
    },
    **{
        f"no {name}": (TEXT.replace(f'name="{name}"', 'name="other"'), f"no joint '{name}'")
        for name in ("hip_pitch_r", "ankle_roll_l", "big_toe_hinge_l")
    },
    "two of one name": (
        TEXT.replace('"thigh_l"', '"thigh_r"').replace(">thigh_l<", ">thigh_r<"),
        "'thigh_r'; rename",
    ),
    "parent that is not there": (
        inside("joint", "knee_l", "<parent>[^<]*", "<parent>leg"),
        r"leg.*knee_l",
    ),
    "link on its own": (with_more(f'<link name="ball">{INERTIAL}</link>'), "float.*ball"),
    "robot on a stand": (
        with_more(
            '<joint name="stand" type="fixed"><parent>world</parent><child>torso</child></joint>'
        ),
        "torso.*must float",
    ),
    # Soles.
    "heel of a ball": (
        inside(
            "link",
            "foot_r",
            f"(?s)(<collision.*?){BOX}",
            r"\1<sphere><radius>.01</radius></sphere>",
        ),
        "foot_r.*<box>, got <sphere>",
    ),
    "heel that touches nothing": (
        inside("link", "foot_r", "(?s)<collision.*</collision>", ""),
        "foot_r.*one <collision>.*got 0",
    ),
    "heel of two boxes": (
        inside(
            "link",
            "foot_r",
            "(?s)(<collision .*?</collision>)",
            rf"\1{SECOND}",
        ),
        "foot_r.*2 collisions",
    ),
    "toe of two boxes": (
        inside(
            "link",
            "big_toe_l",
            "(?s)(<collision .*?</collision>)",
            rf"\1{SECOND}",
        ),
        "big_toe_l.*one <collision>.*got 2",
    ),
    "wider toes": (
        inside("link", "big_toe_l", r"(?s)(<collision.*?0\.028) 0\.022", r"\1 0.030"),
        "big_toe_l.*78 mm",
    ),
    "toe with a motor": (
        inside("link", "big_toe_l", "<ixx>[^<]*", "<ixx>1e-07"),
        "big_toe_l.*<inertial>.*plate",
    ),
    "soles of points": (
        re.sub(r"\s*<drake:(compliant_hydroelastic|hydroelastic_modulus)[^\n]*", "", TEXT),
        "foot_r.*compliant.*drake:hydroelastic_modulus",
    ),
    "toe of a point": (
        inside("link", "lesser_toes_r", "<drake:compliant_hydroelastic />", ""),
        "lesser_toes_r.*drake:compliant_hydroelastic",
    ),
    "hard soles": (
        re.sub(
            r"<drake:compliant_hydroelastic />\s*<drake:hydroelastic_modulus[^\n]*",
            "<drake:rigid_hydroelastic/>",
            TEXT,
        ),
        "foot_r.*drake:compliant_hydroelastic",
    ),
    "turned toe": (
        inside("link", "lesser_toes_l", "(<pose>.*) 0</pose>", r"\1 0.1</pose>"),
        "foot_l with its toes",
    ),
    # Stances.
    "in the air": (TEXT.replace('"khr3hv">', '"khr3hv"><pose>0 0 .3 0 0 0</pose>'), "300 mm"),
    "in the ground": (TEXT.replace('"khr3hv">', '"khr3hv"><pose>0 0 -.1 0 0 0</pose>'), "-100 mm"),
    "walking backwards": (
        TEXT.replace('"khr3hv">', '"khr3hv"><pose>0 0 0 0 0 3.1</pose>'),
        "'torso' must be x forward",
    ),
    "head over heels": (
        inside("link", "torso", "<pose>-0.002[^<]*", "<pose>-0.15 0 0.06 0 0 0"),
        "does not stand.*leans",
    ),
    # What Drake leaves out.
    "plugin": (with_more('<plugin name="a" filename="b"/>'), "line [0-9]+: Drake ignores <plugin>"),
    "sensor": (in_torso('<sensor name="imu" type="imu"/>'), "line 5: Drake ignores <sensor>"),
    "self-collision": (in_torso("<self_collide>1</self_collide>"), "line 5.*<self_collide>"),
    "misspelt element": (in_torso("<gravitation>0</gravitation>"), "line 5.*<gravitation>"),
    "other prefix": (TEXT.replace("drake:c", "d:c"), "foot_r.*drake:compliant"),
    # Files of another kind.
    "URDF of something else": (
        '<robot name="a"><link name="torso"/></robot>',
        "no link 'ankle_r'; it has torso",
    ),
    "MJCF of something else": (
        "<mujoco><worldbody><body name='cart'/></worldbody></mujoco>",
        "no link 'torso'; it has cart",
    ),
    "a page": ("<html><body/></html>", "begins with <html>"),
    "no XML": ("solid robot", "not a well-formed XML"),
    "two robots": (TEXT.replace("</sdf>", '<model name="b"/></sdf>'), "line .*one <model>, got 2"),
    "robot in a robot": (with_more('<model name="b"><link name="c"/></model>'), "<model>, got 2"),
    "robot in a world": (
        TEXT.replace("<model", '<world name="w"><model').replace("</model>", "</model></world>"),
        "<world>",
    ),
    "robot elsewhere": (with_more("<include><uri>model://b</uri></include>"), "line.*<include>"),
    "encoding that nobody knows": (TEXT.replace("?>", ' encoding="runes"?>', 1), "runes.*UTF-8"),
    # Meshes.
    "no mesh": (with_mesh("head.obj"), r"line 5: mesh 'head\.obj'.*there is no file"),
    "mesh of no package": (with_mesh("package://nobody/a.obj"), "'nobody' to ROS_PACKAGE_PATH"),
    "mesh of no model": (with_mesh("model://nobody/a.obj"), "'nobody' to ROS_PACKAGE_PATH"),
    "mesh of the web": (with_mesh("https://example.org/a.obj"), "'https://.*is no file"),
    "mesh for another program": (with_mesh("../a.dae"), r"'\.\./a\.dae'.*\.obj"),
    "mesh of nothing": (with_mesh("../empty.obj"), "of_mesh|empty.obj"),
    "mesh of nothing that collides": (with_mesh("../empty.obj", "collision"), "empty.obj"),
    "mesh with a comma": (with_mesh("../empty.obj", inner="<scale>0,1 1 1</scale>"), "<scale>"),
    "nothing to be seen": (re.sub("(?s)<visual.*?</visual>", "", TEXT), "<visual>"),
}


@pytest.fixture
def robot(tmp_path):
    """Writes a robot's file into a folder of its own."""
    for name in ("a.dae", "empty.obj"):
        (tmp_path / name).write_text("# nothing\n")

    def write(content, name="robot.sdf"):
        path = tmp_path / "robot" / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.mark.parametrize(("content", "told"), BAD.values(), ids=BAD)
def test_a_file_that_would_not_walk_as_it_says_is_one_line_and_no_study(
    robot, capfd, tmp_path, content, told
):
    assert content != TEXT
    path, out = robot(content), tmp_path / "run"
    few = ("--samples=1", "--simulations=1", "--set=confirmation.walks=0", "--workers=1")
    assert main([f"--set=walk.model={path}", f"--out={out}", *few]) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"error: {path}")
    assert printed.err.count("\n") == 1
    assert re.search(told, printed.err)
    assert "drake_gait-" not in printed.err
    assert not out.exists()


ENCODED = '<?xml version="1.0" encoding="{}"?>'
SAME = {
    "Drake's own namespace": TEXT.replace('"http://drake.mit.edu"', '"drake.mit.edu"'),
    "no namespace": TEXT.replace(' xmlns:drake="http://drake.mit.edu"', ""),
    "a byte order mark": TEXT.encode("utf-8-sig"),
    "UTF-16": TEXT.replace('<?xml version="1.0"?>', ENCODED.format("utf-16")).encode("utf-16"),
    "Latin 1": TEXT.replace('<?xml version="1.0"?>', ENCODED.format("latin-1"))
    .replace("<!--Written", "<!--Über")
    .encode("latin-1"),
    "no declaration": TEXT.replace('<?xml version="1.0"?>\n', ""),
    "no zeros": TEXT.replace("<ixy>0</ixy>", "").replace("<iyz>0</iyz>", ""),
    "relative to a link": inside(
        "link",
        "big_toe_r",
        "<pose>0.04114 -0.0136 0.0025 0 0 0",
        '<pose relative_to="__model__">0.04114 -0.0136 0.0025 0 0 0',
    ),
}


@pytest.fixture(scope="module")
def usual():
    """What the shipped robot walks."""
    return simulate(WALKING)


@pytest.mark.parametrize("content", SAME.values(), ids=SAME)
def test_other_ways_to_write_a_robot_walk_the_same(robot, usual, content):
    walk = simulate(WALKING, WalkSettings(model=robot(content)))
    assert (walk.frames, walk.forward, walk.yaw) == (usual.frames, usual.forward, usual.yaw)


FRICTIONS = {
    "of SDFormat": (ODE.format("<mu>0.6</mu><mu2>0.4</mu2>"), "", (0.6, 0.4)),
    "of SDFormat, one": (ODE.format("<mu2>0.4</mu2>"), "", (1.0, 0.4)),
    "none": ("</collision>", "", (1.0, 1.0)),
    "an empty surface": ("<surface><friction/></surface></collision>", "", (1.0, 1.0)),
    "of Drake, static": ("</collision>", "<drake:mu_static>0.3</drake:mu_static>", (0.3, 0.3)),
    "of Drake, dynamic": ("</collision>", "<drake:mu_dynamic>0.2</drake:mu_dynamic>", (0.2, 0.2)),
}


def read_friction(model, factor):
    robot = build_robot(PlantConfig(model=model, friction=factor))
    body, found = robot.plant.GetBodyByName("foot_r"), []
    for geometry in robot.plant.GetCollisionGeometriesForBody(body):
        properties = robot.scene_graph.model_inspector().GetProximityProperties(geometry)
        pair = properties.GetProperty("material", "coulomb_friction")
        found.append([pair.static_friction(), pair.dynamic_friction()])
    return np.array(found)


@pytest.mark.parametrize(("surface", "own", "wanted"), FRICTIONS.values(), ids=FRICTIONS)
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_friction_is_multiplied_however_it_is_written(robot, surface, own, wanted, factor):
    end = "</drake:proximity_properties>"
    text = FRICTION.sub("", TEXT).replace(end, own + end).replace("</collision>", surface)
    path = robot(text)
    before, after = read_friction(path, 1.0), read_friction(path, factor)
    assert (before == wanted).all()

    def on_the_ground(surface):
        return 2.0 * surface * GROUND_FRICTION / (surface + GROUND_FRICTION)

    assert on_the_ground(after) == pytest.approx(factor * on_the_ground(before))


def test_a_limit_or_a_damper_of_a_joint_counts(robot, usual):
    narrow = inside("joint", "knee_r", r"<upper>3\.14159265359", "<upper>0.1")
    damped = inside(
        "joint", "knee_r", "<dynamics />", "<dynamics><damping>0.3</damping></dynamics>"
    )
    for text in (narrow, damped):
        assert simulate(WALKING, WalkSettings(model=robot(text))).forward != usual.forward
    plant, _ = add_robot(DiagramBuilder(), PlantConfig(model=robot(damped)))
    back_emf = 1.373 / Servo().no_load_speed
    found = [plant.GetJointByName(name).default_damping() for name in ("knee_r", "knee_l")]
    assert found == pytest.approx([back_emf + 0.3, back_emf])


def test_all_names_that_are_asked_of_a_robot_are_checked():
    # Whoever asks Drake for a link or a joint by another name finds it missing after a search.
    known = {*default_robot().links, *default_robot().named_joints}
    package = Path(models_folder()).parent / "drake_gait"
    asked = set()
    for path in package.glob("*.py"):
        for name in re.findall(r'(?:Body|Joint|Actuator)ByName\("(\w+)"\)', path.read_text()):
            asked.add(name)
    assert asked <= known


CUBE = "mtllib cube.mtl\n" + "".join(
    f"v {x} {y} {z}\n" for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (-0.02, 0.02)
)
CUBE += "".join(
    f"f {face}\n"
    for face in (
        *("1 2 4", "1 4 3", "5 7 8", "5 8 6", "1 5 6", "1 6 2"),
        *("3 4 8", "3 8 7", "1 3 7", "1 7 5", "2 6 8", "2 8 4"),
    )
)


@pytest.fixture
def meshes(tmp_path):
    folder = tmp_path / "robot" / "meshes"
    folder.mkdir(parents=True)
    (folder / "cube.obj").write_text(CUBE)
    (folder / "cube.mtl").write_text("newmtl red\nKd 1 0 0\n")
    return folder


@pytest.mark.parametrize(
    "uri", ["meshes/cube.obj", "model://robot/meshes/cube.obj", "package://robot/meshes/cube.obj"]
)
@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_meshes_beside_the_file_and_in_its_package_travel_with_the_robot(
    robot, meshes, uri, kind, tmp_path
):
    path = robot(with_mesh(uri, kind))
    read = read_model(path)
    assert {file.path for file in read.files} == {"cube.obj", "cube.mtl"}
    kept = RobotModel.from_plain(json.loads(json.dumps(read.plain())))
    shutil.rmtree(tmp_path / "robot")
    assert kept == read
    assert len(kept.for_walks().files) == (2 if kind == "collision" else 0)
    check_looks(kept, FootDesign())
    try_out(WALKING, WalkSettings(model=kept.for_walks()))


def test_a_mesh_is_part_of_what_a_robot_is(robot, meshes):
    path = robot(with_mesh("meshes/cube.obj"))
    before = read_model(path)
    (meshes / "cube.obj").write_text(CUBE.replace("0.02", "0.03"))
    after = read_model(path)
    assert before.content == after.content
    assert before != after
    assert before.sha256 != after.sha256


def test_a_mesh_on_the_path_of_packages_is_found(robot, meshes, monkeypatch, tmp_path):
    package = tmp_path / "elsewhere" / "hands"
    shutil.copytree(meshes, package)
    (package / "package.xml").write_text(
        '<package format="2"><name>hands</name><version>0.0.0</version></package>'
    )
    path = robot(with_mesh("package://hands/cube.obj"))
    with pytest.raises(ModelError, match="hands"):
        read_model(path)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parent))
    assert len(read_model(path).files) == 2


def test_the_cache_belongs_to_a_content_and_not_to_a_path(robot):
    settings = WalkSettings(model=robot(TEXT))
    usual = simulate(WALKING, settings).forward
    assert robot(inside("joint", "knee_r", "1.373", "0.5")) == settings.model
    weak = simulate(WALKING, settings).forward
    assert weak != usual
    robot(TEXT)
    assert simulate(WALKING, settings).forward == usual == simulate(WALKING).forward


def test_a_shipped_robot_s_name_means_that_one_wherever_the_command_is_given(robot, monkeypatch):
    path = robot(inside("joint", "knee_r", "1.373", "0.5"), "khr3hv.sdf")
    monkeypatch.chdir(path.parent)
    assert read_model("khr3hv.sdf").content == model_path().read_bytes() == TEXT.encode()
    assert read_model("./khr3hv.sdf").content == path.read_bytes() != TEXT.encode()
    assert read_study(default_study()).walk.model == "khr3hv.sdf"


def test_a_name_of_two_robots_is_refused_with_the_way_to_write_either(robot):
    path = robot(inside("joint", "knee_r", "1.373", "0.5"), "khr3hv.sdf")
    with pytest.raises(SettingsError, match=r"'khr3hv\.sdf'.*'\./khr3hv\.sdf'"):
        located("khr3hv.sdf", path.parent)
    assert located("./khr3hv.sdf", path.parent) == str(path)
    path.write_text(TEXT)  # The same robot by both names.
    assert located("khr3hv.sdf", path.parent) == "khr3hv.sdf"


def test_a_robot_that_is_kept_and_changed_is_no_robot(robot):
    plain = read_model(robot(TEXT)).plain()
    for key, value in (("text", TEXT + " "), ("sha256", "abc"), ("files", 3), ("name", None)):
        if key == "name":
            continue
        with pytest.raises(ModelError, match="damaged"):
            RobotModel.from_plain({**plain, key: value})
    with pytest.raises(ModelError, match="damaged"):
        RobotModel.from_plain({})
