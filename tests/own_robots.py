"""Two small bipeds of our own, as URDF and as MJCF, with their robot's files.

The URDF has no hip roll, no toes and knees that turn the other way round; it has a head that nods.
The MJCF has hips that yaw, and one sprung toe on each foot.
"""

from pathlib import Path

SIDES = (("right", -1), ("left", 1))


def _link(name: str, mass: float, box: str = "", z: float = 0.0, *, touches: bool = False) -> str:
    place = f'<origin xyz="0 0 {z}"/>'
    shape = f'{place}<geometry><box size="{box}"/></geometry>'
    seen = f"<visual>{shape}</visual>" if box else ""
    touched = f"<collision>{shape}</collision>" if touches else ""
    moment = 1e-3 * mass
    return (
        f'<link name="{name}"><inertial>{place}<mass value="{mass}"/><inertia ixx="{moment}" '
        f'ixy="0" ixz="0" iyy="{moment}" iyz="0" izz="{moment}"/></inertial>'
        f"{seen}{touched}</link>\n"
    )


def _joint(name: str, parent: str, child: str, xyz: str, axis: str, effort: float = 2.0) -> str:
    return (
        f'<joint name="{name}" type="revolute"><origin xyz="{xyz}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/>'
        f'<limit lower="-2" upper="2" effort="{effort}" velocity="6"/></joint>\n'
    )


def urdf() -> str:
    """The robot without hip roll: 2 kg, its joints without transmissions."""
    text = '<robot name="stiff">\n' + _link("trunk", 1.0, "0.08 0.12 0.16", 0.08, touches=True)
    text += _link("head", 0.1, "0.05 0.05 0.05", 0.03)
    text += _joint("nod", "trunk", "head", "0 0 0.16", "0 1 0", 0.5)
    for side, y in SIDES:
        text += _link(f"{side}_thigh", 0.2, "0.03 0.03 0.1", -0.05)
        text += _link(f"{side}_shin", 0.15, "0.03 0.03 0.1", -0.05)
        text += _link(f"{side}_foot", 0.1, "0.12 0.07 0.01", -0.035, touches=True)
        text += _joint(f"{side}_hip", "trunk", f"{side}_thigh", f"0 {0.05 * y} 0", "0 1 0")
        text += _joint(f"{side}_knee", f"{side}_thigh", f"{side}_shin", "0 0 -0.1", "0 -1 0")
        text += _joint(f"{side}_ankle", f"{side}_shin", f"{side}_foot", "0 0 -0.1", "0 -1 0")
    return text + "</robot>\n"


def urdf_toml() -> str:
    """Its robot's file."""
    text = 'name = "Stiff"\nmodel = "stiff.urdf"\ntorso = "trunk"\nothers = "weld"\n'
    for side, _ in SIDES:
        text += (
            f'[{side}]\nhip_pitch = {{ joint = "{side}_hip", sign = -1 }}\n'
            f'knee = {{ joint = "{side}_knee", sign = -1 }}\nankle_pitch = "{side}_ankle"\n'
            f'foot_link = "{side}_foot"\n'
        )
    return (
        text + "[standing_deg]\nright_hip = -10\nleft_hip = -10\nright_knee = -20\n"
        "left_knee = -20\nright_ankle = 10\nleft_ankle = 10\nnod = 15\n"
        "[servo]\nstiffness_n_m_per_rad = 30\n[limits]\ncom_height_mm = 200\n"
    )


def _body(side: str, y: int) -> str:
    roll = f"{y} 0 0"

    def hinge(name: str, axis: str) -> str:
        return f'<joint name="{side}_{name}" axis="{axis}"/>'

    def inertia(mass: float, z: float = 0.0, x: float = 0.0) -> str:
        moment = 1e-3 * mass
        return f'<inertial pos="{x} 0 {z}" mass="{mass}" diaginertia="{moment} {moment} {moment}"/>'

    return (
        f'<body name="{side}_yaw" pos="0 {0.04 * y} 0">{inertia(0.04)}{hinge("hip_yaw", "0 0 1")}\n'
        f'<body name="{side}_hip" pos="0 0 -0.02">{inertia(0.04)}{hinge("hip_roll", roll)}\n'
        f'<body name="{side}_thigh">{inertia(0.1, -0.04)}{hinge("hip_pitch", "0 1 0")}\n'
        f'<body name="{side}_shin" pos="0 0 -0.08">{inertia(0.08, -0.04)}{hinge("knee", "0 1 0")}\n'
        f'<body name="{side}_block" pos="0 0 -0.08">{inertia(0.04)}'
        f"{hinge('ankle_pitch', '0 1 0')}\n"
        f'<body name="{side}_foot">{inertia(0.08, -0.02)}{hinge("ankle_roll", roll)}\n'
        f'<geom type="box" size="0.045 0.03 0.003" pos="0.005 0 -0.027" friction="0.8"/>\n'
        f'<body name="{side}_toe" pos="0.05 0 -0.027">{inertia(0.02, 0.0, 0.0125)}'
        f'<joint name="{side}_toe_hinge" axis="0 -1 0" range="0 30" damping="0.0002"/>\n'
        f'<geom type="box" size="0.0125 0.03 0.003" pos="0.0125 0 0" friction="0.8"/></body>'
        "</body></body></body></body></body></body>\n"
    )


def mjcf() -> str:
    """The robot with a toe: 1.5 kg, beside a floor, a lamp and a camera of its scene."""
    joints = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
    motors = "".join(
        f'<motor joint="{side}_{name}" ctrlrange="-1.5 1.5"/>\n'
        for side, _ in SIDES
        for name in joints
    )
    return (
        '<mujoco model="toed"><compiler angle="degree" autolimits="true"/>\n'
        '<option timestep="0.001" integrator="implicitfast"/><statistic extent="1"/>\n'
        '<default><joint type="hinge" armature="0.002"/></default>\n'
        '<worldbody><light pos="0 0 3"/><geom name="floor" type="plane" size="1 1 0.1"/>\n'
        '<camera name="side" pos="0 -1 0.3"/>\n'
        '<body name="pelvis" pos="0 0 0.4"><freejoint name="base"/>\n'
        '<inertial pos="0.002 0 0.05" mass="0.7" diaginertia="1.2e-3 9e-4 9e-4"/>\n'
        '<geom type="box" size="0.03 0.05 0.06" pos="0 0 0.06"/><site name="imu"/>\n'
        + "".join(_body(side, y) for side, y in SIDES)
        + f"</body></worldbody>\n<actuator>{motors}</actuator></mujoco>\n"
    )


def mjcf_toml() -> str:
    """Its robot's file."""
    text = 'name = "Toed"\nmodel = "toed.xml"\ntorso = "pelvis"\nothers = "servo"\n'
    for side, sign in SIDES:
        text += (
            f'[{side}]\nhip_roll = {{ joint = "{side}_hip_roll", sign = {sign} }}\n'
            f'hip_pitch = {{ joint = "{side}_hip_pitch", sign = -1 }}\nknee = "{side}_knee"\n'
            f'ankle_pitch = {{ joint = "{side}_ankle_pitch", sign = -1 }}\n'
            f'ankle_roll = {{ joint = "{side}_ankle_roll", sign = {-sign} }}\n'
            f'ankle_link = "{side}_block"\nfoot_link = "{side}_foot"\n'
            f'big_toe = {{ link = "{side}_toe", hinge = "{side}_toe_hinge", '
            "stiffness_n_mm_per_deg = 0.8 }\n"
        )
    return (
        text + "[standing_deg]\nright_hip_pitch = -10\nleft_hip_pitch = -10\nright_knee = 20\n"
        "left_knee = 20\nright_ankle_pitch = -10\nleft_ankle_pitch = -10\n"
    )


def write(folder: Path) -> dict[str, Path]:
    """Write both robots into a folder; returns their robot's files by name."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "stiff.urdf").write_text(urdf())
    (folder / "stiff.toml").write_text(urdf_toml())
    (folder / "toed.xml").write_text(mjcf())
    (folder / "toed.toml").write_text(mjcf_toml())
    return {name: folder / f"{name}.toml" for name in ("stiff", "toed")}
