"""Write the robots in models/ from tables: `python tools/make_models.py`.

All lengths are those of the upright pose: x forward, y left of the mid-plane, z above the sole.
Nothing here is imported by the package.

Link masses, centres of mass, inertias and joint origins of `khr3hv.sdf` and `khr3hv_cad.sdf` are
those of a public CAD model of the KHR-3HV (MIT licence). The foot is the paper's (section II.B): a
heel plate and two sprung toes side by side, on the outline of the real foot.

`khr3hv.sdf` splits 1.5 kg between body and legs. Its standing centre of mass is 245.0 mm above the
ground: there the paper's limit of 243.53 mm means 'upright'. `khr3hv_cad.sdf` keeps the CAD's own
distribution, scaled to 1.5 kg.

`op3.sdf` is the ROBOTIS OP3; the sources of its figures stand above its table.
"""

import argparse
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

MODELS = Path(__file__).parents[1] / "models"

TOTAL_MASS = 1.5  # kg; the maker's, and the paper's section II.A.
HEIGHT = 0.40105  # m; the same.
STANDING_COM_HEIGHT = 0.2450  # m; 1.47 mm above the paper's limit, Eq. 13.

STALL_TORQUE = 1.373  # N·m; 14.0 kgf·cm, KRS-2552/2555 data.
REFLECTED_ROTOR_INERTIA = 1.0e-3  # kg·m² at the joint; a fit of a comparable servo.

# The paper's foot [m], section II.B. The ankle stands where the real robot's does: its pitch axis
# 61.9 mm in front of the heel edge.
HEEL_LENGTH, FOOT_LENGTH, FOOT_WIDTH, BIG_TOE_WIDTH = 0.095, 0.123, 0.078, 0.022
TOE_GAP = 0.001  # between the two toes, so that they pass each other freely
PLATE_THICKNESS = 0.005
HEEL_EDGE_X = 0.00804 - 0.0619
FOOT_CENTRE_Y = 0.0416

# Surface values m whose combination 2*m*m_ground/(m + m_ground) with a ground of 1.0 is the pair
# value M that the paper gives: m = M / (2 - M).
HEEL_PAIR_FRICTION = (0.5, 0.417)
TOE_PAIR_FRICTION = (0.17, 0.155)

BODY_FRICTION = (0.3, 0.3)
HYDROELASTIC_MODULUS = 1.0e6  # Pa; softer rock, harder blur forces (docs/explanation/robot.md)
HUNT_CROSSLEY_DISSIPATION = 5.0  # s/m

PAPER_BIG_TOE_STIFFNESS = 0.52e-3 * 180.0 / math.pi  # N·m/rad; 0.52 N·mm/deg
PAPER_LESSER_TOES_STIFFNESS = 0.26e-3 * 180.0 / math.pi  # N·m/rad; 0.26 N·mm/deg
TOE_DAMPING = 2.0e-4  # N·m·s/rad; about 0.7 of critical for the big toe

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Mass:
    """Mass [kg], centre of mass [m] and inertia about it [kg·m²], in the upright robot's frame."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray

    def scaled(self, factor: float) -> "Mass":
        """The same shape made of another material."""
        return Mass(mass=self.mass * factor, com=self.com, inertia=self.inertia * factor)


def cad(mass_g: float, com_mm: Vector, moments: Vector, products: Vector = (0, 0, 0)) -> Mass:
    """One row of the CAD table; moments (xx, yy, zz) and products (xy, xz, yz) in kg·m²."""
    xy, xz, yz = products
    inertia = np.diag(moments) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
    return Mass(mass=mass_g * 1e-3, com=np.array(com_mm) * 1e-3, inertia=inertia)


def combined(parts: Iterable[Mass]) -> Mass:
    """Rigidly joined masses as one (parallel-axis theorem)."""
    parts = list(parts)
    mass = sum(part.mass for part in parts)
    com = sum((part.mass * part.com for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        r = part.com - com
        inertia += part.inertia + part.mass * (r @ r * np.eye(3) - np.outer(r, r))
    return Mass(mass=mass, com=com, inertia=inertia)


def mirrored(part: Mass) -> Mass:
    """The right-hand twin of a left-hand part."""
    flip = np.diag([1.0, -1.0, 1.0])
    return Mass(mass=part.mass, com=flip @ part.com, inertia=flip @ part.inertia @ flip)


def plate(mass: float, lower: Vector, upper: Vector) -> Mass:
    """A homogeneous box between two corners."""
    size = np.subtract(upper, lower)
    square = size**2
    moments = mass / 12.0 * (square.sum() - square)
    return Mass(mass=mass, com=np.add(upper, lower) / 2.0, inertia=np.diag(moments))


LEFT_ARM = (
    cad(12.12, (22.63, 57.65, 344.40), (1e-6, 4e-6, 4e-6)),
    cad(90.77, (15.64, 73.90, 308.75), (5.4e-5, 6.4e-5, 1.8e-5), (0, -1e-5, 0)),
    cad(44.77, (22.26, 73.90, 260.08), (6e-6, 8e-6, 1e-5)),
    cad(29.84, (33.88, 74.46, 212.45), (1.8e-5, 1.6e-5, 4e-6)),
)
TRUNK = (
    cad(134.08, (-0.49, 0.0, 276.04), (6.3e-5, 3.6e-5, 6.8e-5)),
    cad(175.13, (10.87, 0.0, 340.36), (1.58e-4, 6.6e-5, 1.76e-4)),
    cad(86.60, (-42.41, 0.0, 332.38), (1.18e-4, 5.2e-5, 9.8e-5)),
    cad(33.76, (41.50, 0.0, 325.42), (3.4e-5, 1.9e-5, 3.6e-5), (0, -3e-6, 0)),
    cad(12.78, (25.54, 0.0, 379.04), (2e-6, 4e-6, 3e-6)),
)
# The hip-yaw joint is not one of the ten; its bracket is part of the torso.
LEFT_YAW_BRACKET = cad(5.70, (10.99, 20.59, 250.25), (1e-6, 2e-6, 2e-6))
LEFT_LEG = {
    "hip": cad(66.90, (11.41, 29.17, 228.25), (2.0e-5, 1.4e-5, 1.5e-5)),
    "thigh": cad(90.97, (14.00, 28.70, 161.64), (5.9e-5, 5.6e-5, 1.3e-5), (0, 4e-6, 0)),
    "shin": cad(60.94, (15.89, 29.23, 88.58), (2.9e-5, 2.6e-5, 1.1e-5), (0, -5e-6, 0)),
    "ankle": cad(67.58, (8.23, 29.04, 32.56), (2.0e-5, 1.4e-5, 1.6e-5)),
}
LEFT_FOOT = cad(38.47, (7.09, 41.60, 4.74), (2.3e-5, 4.8e-5, 6.9e-5))

HINGE_X = HEEL_EDGE_X + HEEL_LENGTH
TOE_TIP_X = HEEL_EDGE_X + FOOT_LENGTH
INNER_Y = FOOT_CENTRE_Y - FOOT_WIDTH / 2.0
OUTER_Y = FOOT_CENTRE_Y + FOOT_WIDTH / 2.0
BIG_TOE = ((HINGE_X, INNER_Y, 0.0), (TOE_TIP_X, INNER_Y + BIG_TOE_WIDTH, PLATE_THICKNESS))
LESSER_TOES = (
    (HINGE_X, INNER_Y + BIG_TOE_WIDTH + TOE_GAP, 0.0),
    (TOE_TIP_X, OUTER_Y, PLATE_THICKNESS),
)
HEEL = ((HEEL_EDGE_X, INNER_Y, 0.0), (HINGE_X, OUTER_Y, PLATE_THICKNESS))

# name, parent, child, origin of the left joint [m], axis, range [deg] (the paper's Table I).
# Axes make flexion, dorsiflexion and toe extension positive; equal hip and ankle roll angles lean
# the legs over the right foot (towards -y) and keep torso and soles level.
JOINTS: tuple[tuple[str, str, str, Vector, Vector, tuple[float, float]], ...] = (
    ("hip_roll", "torso", "hip", (0.02766, 0.0177, 0.23490), (1, 0, 0), (-15, 15)),
    ("hip_pitch", "hip", "thigh", (0.01141, 0.0452, 0.19540), (0, -1, 0), (-50, 50)),
    ("knee", "thigh", "shin", (0.01141, 0.0452, 0.13040), (0, 1, 0), (0, 60)),
    ("ankle_pitch", "shin", "ankle", (0.00804, 0.0457, 0.06549), (0, -1, 0), (-50, 50)),
    ("ankle_roll", "ankle", "foot", (0.02779, 0.0177, 0.02599), (-1, 0, 0), (-15, 15)),
    (
        "big_toe_hinge",
        "foot",
        "big_toe",
        (HINGE_X, INNER_Y + BIG_TOE_WIDTH / 2.0, PLATE_THICKNESS / 2.0),
        (0, -1, 0),
        (0, 30),
    ),
    (
        "lesser_toes_hinge",
        "foot",
        "lesser_toes",
        (HINGE_X, (LESSER_TOES[0][1] + OUTER_Y) / 2.0, PLATE_THICKNESS / 2.0),
        (0, -1, 0),
        (0, 30),
    ),
)


def surface_friction(pair: tuple[float, float]) -> tuple[float, float]:
    """Surface coefficients that give `pair` against a ground of 1.0 (Drake: 2ab / (a + b))."""
    static, kinetic = pair
    return static / (2.0 - static), kinetic / (2.0 - kinetic)


def foot_masses(foot: Mass) -> dict[str, Mass]:
    """Heel part and toes of one left foot: toes of the foot's areal density, the rest the heel."""
    areal_density = foot.mass / (FOOT_LENGTH * FOOT_WIDTH)

    def toe(lower: Vector, upper: Vector) -> Mass:
        area = (upper[0] - lower[0]) * (upper[1] - lower[1])
        return plate(areal_density * area, lower, upper)

    toes = {"big_toe": toe(*BIG_TOE), "lesser_toes": toe(*LESSER_TOES)}
    heel_mass = foot.mass - sum(part.mass for part in toes.values())
    # The whole foot keeps the CAD's centre of mass.
    moment = foot.mass * foot.com - sum(
        (part.mass * part.com for part in toes.values()), np.zeros(3)
    )
    heel = plate(heel_mass, *HEEL)
    return {"foot": Mass(mass=heel_mass, com=moment / heel_mass, inertia=heel.inertia), **toes}


def link_masses(leg_scale: float, torso_mass: float) -> dict[str, Mass]:
    """Every link's mass, with the legs scaled by `leg_scale` and a torso of `torso_mass` kg."""
    arms = [part for left in LEFT_ARM for part in (left, mirrored(left))]
    brackets = [LEFT_YAW_BRACKET, mirrored(LEFT_YAW_BRACKET)]
    torso = combined([*TRUNK, *arms, *brackets])
    masses = {"torso": torso.scaled(torso_mass / torso.mass)}
    leg = {**LEFT_LEG, **foot_masses(LEFT_FOOT)}
    for name, part in leg.items():
        masses[f"{name}_l"] = part.scaled(leg_scale)
        masses[f"{name}_r"] = mirrored(part).scaled(leg_scale)
    return masses


def cad_masses() -> dict[str, Mass]:
    """The CAD's own distribution, scaled to the maker's 1.5 kg."""
    as_drawn = link_masses(1.0, 1.0)
    legs = sum(part.mass for name, part in as_drawn.items() if name != "torso")
    trunk = sum(part.mass for part in TRUNK)
    torso = trunk + 2.0 * (sum(part.mass for part in LEFT_ARM) + LEFT_YAW_BRACKET.mass)
    scale = TOTAL_MASS / (torso + legs)
    return link_masses(scale, torso * scale)


def raised_masses() -> dict[str, Mass]:
    """1.5 kg split between torso and legs so that it stands at STANDING_COM_HEIGHT."""
    as_drawn = link_masses(1.0, 1.0)
    legs = combined(part for name, part in as_drawn.items() if name != "torso")
    torso = as_drawn["torso"]
    share = (STANDING_COM_HEIGHT - legs.com[2]) / (torso.com[2] - legs.com[2])
    return link_masses(TOTAL_MASS * (1.0 - share) / legs.mass, TOTAL_MASS * share)


# --- Shapes ---------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Shape:
    """A box between two corners [m] in the upright robot's frame, seen or touched or both."""

    name: str
    lower: Vector
    upper: Vector
    colour: str | None = None
    """Red, green, blue, alpha; None: only touched."""
    axis: str | None = None
    """'x', 'y' or 'z': not the box is seen but the round bar within it along this axis."""
    touch: tuple[float, float] | None = None
    """Surface friction (static, kinetic) of its collision geometry; None: only seen."""
    mirrored: bool = False
    """Whether it is the twin of a left-hand shape."""


def box(
    name: str,
    lower: Vector,
    upper: Vector,
    colour: str | None = None,
    touch: tuple[float, float] | None = None,
) -> Shape:
    """A box between two corners, see `Shape`."""
    return Shape(name=name, lower=lower, upper=upper, colour=colour, touch=touch)


def disc(name: str, axis: str, centre: Vector, radius: float, depth: float, colour: str) -> Shape:
    """A round bar to be seen: a servo's horn, a bearing, an eye."""
    half = np.where(np.array(list("xyz")) == axis, depth / 2.0, radius)
    lower, upper = np.subtract(centre, half), np.add(centre, half)
    return Shape(name=name, lower=tuple(lower), upper=tuple(upper), colour=colour, axis=axis)


def link_plates(
    name: str, top: tuple[float, float], bottom: tuple[float, float], inner: float, outer: float
) -> tuple[Shape, ...]:
    """Aluminium plates on both sides of a leg's link, with a bearing at either joint.

    `top` and `bottom` are the joints' x and z [m], `inner` and `outer` the plates' y [m].
    """
    shapes = []
    for side, y in (("inner", inner), ("outer", outer)):
        # The bearing stands out of the plate, away from the servo.
        for end, (x, z) in (("top", top), ("bottom", bottom)):
            shapes.append(disc(f"{name}_{side}_{end}", "y", (x, y, z), 0.0105, 0.0030, ALUMINIUM))
            shapes.append(disc(f"{name}_{side}_{end}_pin", "y", (x, y, z), 0.0045, 0.0042, GREY))
        x = (top[0] + bottom[0]) / 2.0
        lower, upper = (x - 0.0080, y - 0.0012, bottom[1]), (x + 0.0080, y + 0.0012, top[1])
        shapes.append(
            Shape(name=f"{name}_{side}_plate", lower=lower, upper=upper, colour=ALUMINIUM)
        )
    return tuple(shapes)


# The real robot: white covers, black servos, bare aluminium between them. The toes have colours of
# their own, that colour-blind readers tell apart.
WHITE, ALUMINIUM = "0.93 0.93 0.91 1", "0.66 0.68 0.72 1"
BLACK, GREY, BLUE = "0.15 0.15 0.17 1", "0.25 0.26 0.29 1", "0.00 0.36 0.66 1"
GLOW, ORANGE, SKY = "0.45 0.80 0.98 1", "0.90 0.60 0.00 1", "0.34 0.71 0.91 1"

TORSO_SHAPES = (
    # What is touched when it falls.
    box("chest", (-0.030, -0.048, 0.288), (0.040, 0.048, 0.358), touch=BODY_FRICTION),
    box("backpack", (-0.058, -0.040, 0.290), (-0.030, 0.040, 0.365), GREY, touch=BODY_FRICTION),
    box("waist", (-0.022, -0.030, 0.250), (0.030, 0.030, 0.288), touch=BODY_FRICTION),
    box("head", (0.000, -0.022, 0.366), (0.044, 0.022, HEIGHT), touch=BODY_FRICTION),
    # Chest: an aluminium frame, a broad white breast above a narrow belly.
    box("frame", (-0.030, -0.044, 0.292), (0.030, 0.044, 0.356), ALUMINIUM),
    box("collar", (-0.024, -0.047, 0.350), (0.040, 0.047, 0.360), WHITE),
    box("breast", (0.024, -0.047, 0.322), (0.048, 0.047, 0.352), WHITE),
    box("belly", (0.024, -0.033, 0.290), (0.043, 0.033, 0.322), WHITE),
    box("flank", (-0.024, -0.047, 0.300), (0.020, 0.047, 0.336), WHITE),
    box("badge", (0.048, -0.026, 0.330), (0.0495, 0.026, 0.345), BLUE),
    box("vent_upper", (0.043, -0.020, 0.309), (0.044, 0.020, 0.314), GREY),
    box("vent_lower", (0.043, -0.020, 0.298), (0.044, 0.020, 0.303), GREY),
    # Backpack: the controller's box with its lid and lights.
    box("lid", (-0.060, -0.034, 0.298), (-0.058, 0.034, 0.357), BLACK),
    box("lights", (-0.061, -0.020, 0.342), (-0.060, 0.020, 0.347), GLOW),
    # Waist: two yaw servos that do not turn here, and a plate.
    box("waist_plate", (-0.024, -0.036, 0.280), (0.032, 0.036, 0.290), ALUMINIUM),
    box("yaw_servos", (-0.014, -0.032, 0.254), (0.030, 0.032, 0.280), BLACK),
    box("hip_plate", (-0.010, -0.032, 0.248), (0.032, 0.032, 0.254), ALUMINIUM),
    # Head: a white helmet with a dark face.
    disc("neck", "z", (0.022, 0.0, 0.363), 0.010, 0.012, GREY),
    box("helmet", (0.000, -0.021, 0.371), (0.038, 0.021, 0.397), WHITE),
    box("crown", (0.003, -0.016, 0.397), (0.034, 0.016, HEIGHT), WHITE),
    box("brow", (0.038, -0.021, 0.390), (0.045, 0.021, 0.397), WHITE),
    box("face", (0.038, -0.019, 0.374), (0.042, 0.019, 0.390), BLACK),
    box("chin", (0.010, -0.014, 0.366), (0.043, 0.014, 0.374), WHITE),
    disc("eye_l", "x", (0.0425, 0.0095, 0.383), 0.0038, 0.002, GLOW),
    disc("eye_r", "x", (0.0425, -0.0095, 0.383), 0.0038, 0.002, GLOW),
    disc("ear_l", "y", (0.018, 0.0225, 0.384), 0.009, 0.005, BLUE),
    disc("ear_r", "y", (0.018, -0.0225, 0.384), 0.009, 0.005, BLUE),
)
LEFT_ARM_SHAPES = (
    box("upper_arm", (0.000, 0.060, 0.270), (0.034, 0.088, 0.352), touch=BODY_FRICTION),
    box("lower_arm", (0.012, 0.062, 0.205), (0.044, 0.086, 0.268), touch=BODY_FRICTION),
    box("hand", (0.018, 0.064, 0.176), (0.044, 0.084, 0.205), touch=BODY_FRICTION),
    disc("shoulder", "y", (0.020, 0.0535, 0.341), 0.014, 0.015, BLACK),
    box("shoulder_cap", (0.001, 0.060, 0.334), (0.039, 0.091, 0.360), WHITE),
    box("shoulder_mark", (0.008, 0.091, 0.342), (0.032, 0.0918, 0.350), BLUE),
    box("upper_arm_servo", (0.000, 0.063, 0.288), (0.031, 0.085, 0.334), BLACK),
    box("upper_arm_cover", (0.004, 0.061, 0.296), (0.034, 0.088, 0.326), WHITE),
    box("elbow_bracket", (0.010, 0.060, 0.258), (0.032, 0.087, 0.290), ALUMINIUM),
    disc("elbow", "y", (0.021, 0.0735, 0.270), 0.0115, 0.030, GREY),
    box("lower_arm_servo", (0.014, 0.063, 0.222), (0.042, 0.085, 0.262), BLACK),
    box("lower_arm_cover", (0.011, 0.061, 0.212), (0.046, 0.087, 0.246), WHITE),
    disc("wrist", "z", (0.030, 0.0740, 0.209), 0.009, 0.010, GREY),
    box("palm", (0.018, 0.065, 0.192), (0.044, 0.083, 0.205), GREY),
    box("fingers", (0.035, 0.066, 0.174), (0.043, 0.082, 0.194), WHITE),
    box("thumb", (0.019, 0.068, 0.178), (0.026, 0.080, 0.194), WHITE),
)
LEFT_LEG_SHAPES = {
    "hip": (
        box("hip_bracket", (0.000, 0.010, 0.188), (0.024, 0.048, 0.216), touch=BODY_FRICTION),
        box("hip_roll_servo", (-0.010, 0.0075, 0.214), (0.028, 0.040, 0.245), BLACK),
        disc("hip_roll_horn", "x", (0.0295, 0.0177, 0.2349), 0.0095, 0.004, ALUMINIUM),
        box("hip_pitch_servo", (-0.008, 0.013, 0.184), (0.031, 0.044, 0.214), BLACK),
        box("hip_stripe", (0.031, 0.015, 0.202), (0.0316, 0.042, 0.206), ALUMINIUM),
    ),
    "thigh": (
        box("thigh_plate", (0.000, 0.010, 0.124), (0.024, 0.048, 0.150), touch=BODY_FRICTION),
        *link_plates("thigh", (0.01141, 0.1954), (0.01141, 0.1304), 0.0100, 0.0480),
        box("thigh_servo", (-0.006, 0.0135, 0.136), (0.026, 0.0445, 0.178), BLACK),
        box("thigh_cover", (0.024, 0.012, 0.142), (0.035, 0.046, 0.183), WHITE),
        box("thigh_mark", (0.035, 0.023, 0.168), (0.0358, 0.035, 0.176), BLUE),
    ),
    "shin": (
        box("shin_servo", (-0.004, 0.014, 0.084), (0.034, 0.044, 0.122), touch=BODY_FRICTION),
        *link_plates("shin", (0.01141, 0.1304), (0.00804, 0.0655), 0.0070, 0.0510),
        box("knee_servo", (-0.008, 0.0140, 0.086), (0.027, 0.0440, 0.120), BLACK),
        box("shin_guard", (0.025, 0.010, 0.080), (0.037, 0.048, 0.119), WHITE),
        box("knee_cap", (0.026, 0.016, 0.119), (0.036, 0.042, 0.134), WHITE),
        box("calf", (-0.014, 0.014, 0.084), (-0.006, 0.044, 0.116), WHITE),
    ),
    "ankle": (
        box("ankle_pitch_servo", (-0.012, 0.013, 0.043), (0.026, 0.045, 0.076), BLACK),
        box("ankle_roll_servo", (-0.010, 0.0075, 0.014), (0.028, 0.040, 0.043), BLACK),
        disc("ankle_roll_horn", "x", (0.0295, 0.0177, 0.02599), 0.0095, 0.004, ALUMINIUM),
    ),
    "foot": (
        box("heel", HEEL[0], HEEL[1], GREY, touch=surface_friction(HEEL_PAIR_FRICTION)),
        box("front_bracket", (0.0315, 0.0090, 0.005), (0.0345, 0.0264, 0.032), ALUMINIUM),
        box("rear_bracket", (-0.0160, 0.0090, 0.005), (-0.0130, 0.0264, 0.032), ALUMINIUM),
        box("instep", (-0.0160, 0.0090, 0.005), (0.0345, 0.0264, 0.008), ALUMINIUM),
        box(
            "outer_rim",
            (HEEL_EDGE_X, OUTER_Y - 0.004, 0.005),
            (HINGE_X - 0.004, OUTER_Y, 0.010),
            WHITE,
        ),
        box(
            "heel_rim", (HEEL_EDGE_X, INNER_Y, 0.005), (HEEL_EDGE_X + 0.004, OUTER_Y, 0.010), WHITE
        ),
    ),
    # One box each, which the foot design resizes.
    "big_toe": (
        box("big_toe", BIG_TOE[0], BIG_TOE[1], ORANGE, touch=surface_friction(TOE_PAIR_FRICTION)),
    ),
    "lesser_toes": (
        box(
            "lesser_toes",
            LESSER_TOES[0],
            LESSER_TOES[1],
            SKY,
            touch=surface_friction(TOE_PAIR_FRICTION),
        ),
    ),
}


def mirrored_shape(shape: Shape, name: str) -> Shape:
    """The right-hand twin of a left-hand shape."""
    (x0, y0, z0), (x1, y1, z1) = shape.lower, shape.upper
    return replace(shape, name=name, lower=(x0, -y1, z0), upper=(x1, -y0, z1), mirrored=True)


def link_shapes() -> dict[str, list[Shape]]:
    """Every link's shapes."""
    shapes = {"torso": list(TORSO_SHAPES)}
    for shape in LEFT_ARM_SHAPES:
        shapes["torso"] += [
            replace(shape, name=f"{shape.name}_l"),
            mirrored_shape(shape, f"{shape.name}_r"),
        ]
    for link, parts in LEFT_LEG_SHAPES.items():
        shapes[f"{link}_l"] = list(parts)
        shapes[f"{link}_r"] = [mirrored_shape(part, part.name) for part in parts]
    return shapes


# --- Writing --------------------------------------------------------------------------------------


def numbers(values: Iterable[float]) -> str:
    """Numbers as SDF text: twelve digits, no negative zero."""
    return " ".join(f"{float(value) + 0.0:.12g}" for value in np.round(list(values), 15))


def element(
    parent: ElementTree.Element, tag: str, text: object = None, **attributes: str
) -> ElementTree.Element:
    """Append a child with optional text."""
    child = ElementTree.SubElement(parent, tag, attributes)
    if text is not None:
        child.text = f"{text:.12g}" if isinstance(text, float) else str(text)
    return child


def add_link(
    model: ElementTree.Element, name: str, origin: np.ndarray, mass: Mass, shapes: list[Shape]
) -> None:
    """Append one link whose frame stands at `origin`, upright."""
    link = element(model, "link", name=name)
    element(link, "pose", numbers([*origin, 0, 0, 0]))
    inertial = element(link, "inertial")
    element(inertial, "pose", numbers([*(mass.com - origin), 0, 0, 0]))
    element(inertial, "mass", mass.mass)
    inertia = element(inertial, "inertia")
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        element(inertia, f"i{'xyz'[i]}{'xyz'[j]}", numbers([mass.inertia[i, j]]))
    for shape in shapes:
        if shape.colour is not None:
            item = add_shape(link, "visual", shape, origin)
            element(element(item, "material"), "diffuse", shape.colour)
        if shape.touch is not None:
            add_contact(add_shape(link, "collision", shape, origin), shape.touch)


def add_shape(
    link: ElementTree.Element, kind: str, shape: Shape, origin: np.ndarray
) -> ElementTree.Element:
    """Append the geometry of a visual or a collision element."""
    item = element(link, kind, name=f"{shape.name}_{kind}")
    centre = np.add(shape.lower, shape.upper) / 2.0 - origin
    size = np.subtract(shape.upper, shape.lower)
    geometry = ElementTree.Element("geometry")
    if shape.axis is None:
        # Drake cuts a box into tetrahedra along one diagonal of its faces: half a turn about x
        # mirrors the cut, without which a mirrored gait would not walk a mirrored path.
        turned = shape.mirrored and kind == "collision"
        turn = (math.pi if turned else 0.0, 0.0, 0.0)
        element(element(geometry, "box"), "size", numbers(size))
    else:
        # SDF's cylinders stand along z.
        turn = {"x": (0.0, math.pi / 2.0, 0.0), "y": (math.pi / 2.0, 0.0, 0.0)}.get(
            shape.axis, (0.0, 0.0, 0.0)
        )
        length, along = size["xyz".index(shape.axis)], "xyz".index(shape.axis)
        bar = element(geometry, "cylinder")
        element(bar, "radius", numbers([np.delete(size, along).min() / 2.0]))
        element(bar, "length", numbers([length]))
    element(item, "pose", numbers([*centre, *turn]))
    item.append(geometry)
    return item


def add_contact(collision: ElementTree.Element, friction: tuple[float, float]) -> None:
    """Append the properties of a compliant hydroelastic surface."""
    contact = element(collision, "drake:proximity_properties")
    element(contact, "drake:compliant_hydroelastic")
    element(contact, "drake:hydroelastic_modulus", HYDROELASTIC_MODULUS)
    element(contact, "drake:hunt_crossley_dissipation", HUNT_CROSSLEY_DISSIPATION)
    element(contact, "drake:mu_static", friction[0])
    element(contact, "drake:mu_dynamic", friction[1])


def add_hinge(
    model: ElementTree.Element, name: str, parent: str, child: str, axis: Vector
) -> tuple[ElementTree.Element, ElementTree.Element]:
    """Append a hinge without limits; returns the joint and its axis."""
    joint = element(model, "joint", name=name, type="revolute")
    element(joint, "parent", parent)
    element(joint, "child", child)
    hinge = element(joint, "axis")
    element(hinge, "xyz", numbers(axis))
    return joint, hinge


def add_limit(hinge: ElementTree.Element, lower: float, upper: float, effort: float) -> None:
    """Append the stops of a hinge [rad] and what its servo can hold [N·m], 0 without a servo."""
    limit = element(hinge, "limit")
    element(limit, "lower", lower)
    element(limit, "upper", upper)
    element(limit, "effort", effort)


def add_rotor(joint: ElementTree.Element, inertia: float) -> None:
    """Append a servo's inertia [kg·m²], all of it as it acts at the joint: a gear ratio of one."""
    element(joint, "drake:rotor_inertia", inertia)
    element(joint, "drake:gear_ratio", 1.0)


def add_joint(
    model: ElementTree.Element,
    name: str,
    parent: str,
    child: str,
    axis: Vector,
    degrees: tuple[float, float],
) -> None:
    """Append one hinge of the KHR-3HV: a servo's, or a toe's with its torsion spring."""
    joint, hinge = add_hinge(model, name, parent, child, axis)
    if "toe" in name:
        lower, upper = (math.radians(value) for value in degrees)
        add_limit(hinge, lower, upper, 0.0)
        dynamics = element(hinge, "dynamics")
        big = name.startswith("big")
        stiffness = PAPER_BIG_TOE_STIFFNESS if big else PAPER_LESSER_TOES_STIFFNESS
        element(dynamics, "damping", TOE_DAMPING)
        element(dynamics, "spring_reference", 0.0)
        element(dynamics, "spring_stiffness", stiffness)
    else:
        # Only the toes have mechanical stops; the servos' commands are held in Table I's ranges.
        add_limit(hinge, -math.pi, math.pi, STALL_TORQUE)
        element(hinge, "dynamics")
        add_rotor(joint, REFLECTED_ROTOR_INERTIA)


def new_model(name: str, *comments: str) -> tuple[ElementTree.Element, ElementTree.Element]:
    """Begin a file; returns its root and the model."""
    root = ElementTree.Element("sdf", {"version": "1.9", "xmlns:drake": "http://drake.mit.edu"})
    for comment in comments:
        root.append(ElementTree.Comment(comment))
    return root, element(root, "model", name=name)


def written(root: ElementTree.Element, model: ElementTree.Element, links: Iterable[str]) -> str:
    """Return the text of a file whose links do not touch each other."""
    # The upper body is fixed and equal roll angles keep the feet apart: a robot that has not
    # fallen does not touch itself.
    group = element(model, "drake:collision_filter_group", name="robot")
    for name in links:
        element(group, "drake:member", name)
    element(group, "drake:ignored_collision_filter_group", "robot")
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def sdf(masses: dict[str, Mass], comment: str) -> str:
    """The KHR-3HV as SDF text."""
    root, model = new_model("khr3hv", comment)
    shapes = link_shapes()
    torso_origin = np.array([0.01141, 0.0, 0.23490])
    add_link(model, "torso", torso_origin, masses["torso"], shapes["torso"])
    for side, mirror in (("r", -1.0), ("l", 1.0)):
        for _, _, child, origin, _, _ in JOINTS:
            name = f"{child}_{side}"
            place = np.array(origin) * (1.0, mirror, 1.0)
            add_link(model, name, place, masses[name], shapes[name])
        for joint, parent, child, _, axis, degrees in JOINTS:
            above = parent if parent == "torso" else f"{parent}_{side}"
            add_joint(model, f"{joint}_{side}", above, f"{child}_{side}", axis, degrees)
    return written(root, model, masses)


# --- ROBOTIS OP3 ----------------------------------------------------------------------------------
#
# Sources; the figures were taken, no code and no mesh:
#
# Masses, inertias, joints' origins, axes, ranges, names: op3_description/urdf in
#     github.com/ROBOTIS-GIT/ROBOTIS-OP3-Common, commit 0780e54c (Apache 2.0), from ROBOTIS' CAD.
# Boxes: the bounds of its meshes, to 1 mm. Where none could be read (body, and the pairs of servos
#     at hip and ankle) the homogeneous box with the link's inertia.
# Sole, its friction, rotor inertia (armature): robotis_op3/op3.xml in
#     github.com/google-deepmind/mujoco_menagerie, commit 361161b2 (Apache 2.0). The sole there is
#     two boxes, of 127 x 56 and 114 x 78 mm; it is one of 127 x 78 mm here.
# Servo: XM430-W350 at 12.0 V, emanual.robotis.com/docs/en/dxl/x/xm430-w350.
# Height of about 510 mm, weight of about 3.5 kg: emanual.robotis.com/docs/en/platform/op3/.
#
# The links of the URDF weigh 3.147 kg, 10 % less than the manual's figure. Where the rest sits is
# not published, so nothing is added. Head and arms are part of the torso; the arms hang down.
# Body and head are up to 0.4 mm off the mid-plane. They are made symmetrical, so that a mirrored
# gait walks a mirrored path.

OP3_STALL_TORQUE = 4.1  # N·m
OP3_ROTOR_INERTIA = 0.045  # kg·m² at the joint
OP3_RANGE = 0.9 * math.pi  # rad
OP3_PAIR_FRICTION = (1.0, 1.0)
OP3_BODY_FRICTION = (0.2, 0.2)  # Of all links but the feet in ROBOTIS' Gazebo settings.
OP3_BODY_HEIGHT = 0.0285 + 0.11015 + 0.110 + 0.0305  # m; hips' yaw joints above the sole.

# joint, origin of the left one in its parent [m], axis on the left, axis on the right.
OP3_JOINTS: tuple[tuple[str, Vector, Vector, Vector], ...] = (
    ("hip_yaw", (0.0, 0.035, 0.0), (0, 0, -1), (0, 0, -1)),
    ("hip_roll", (-0.024, 0.0, -0.0285), (-1, 0, 0), (-1, 0, 0)),
    ("hip_pitch", (0.0241, 0.019, 0.0), (0, 1, 0), (0, -1, 0)),
    ("knee", (0.0, 0.0, -0.11015), (0, 1, 0), (0, -1, 0)),
    ("ank_pitch", (0.0, 0.0, -0.110), (0, -1, 0), (0, 1, 0)),
    ("ank_roll", (-0.0241, -0.019, 0.0), (1, 0, 0), (1, 0, 0)),
)
# Rows of `cad` in the link's own frame, on the left; a link has the name of the joint above it.
OP3_LEFT_LEG = {
    "hip_yaw": cad(11.81, (-1.57, 0, -7.74), (1.51e-6, 4.30e-6, 4.12e-6), (0, 1e-8, 0)),
    "hip_roll": cad(
        178.86,
        (3.88, 0.28, -12.14),
        (4.661e-5, 1.2523e-4, 1.0857e-4),
        (-1.01e-6, -1.31e-6, -6e-8),
    ),
    "hip_pitch": cad(
        115.43,
        (0.59, -19.01, -84.08),
        (1.0499e-4, 9.613e-5, 2.493e-5),
        (-1e-8, -7.1e-7, 3.53e-6),
    ),
    "knee": cad(40.15, (0, -21.51, -55.00), (3.715e-5, 2.751e-5, 1.511e-5)),
    "ank_pitch": cad(
        178.86,
        (-20.22, -18.72, 12.14),
        (4.661e-5, 1.2523e-4, 1.0857e-4),
        (-1.01e-6, 1.31e-6, 6e-8),
    ),
    "ank_roll": cad(
        69.34,
        (23.73, 10.37, -27.60),
        (4.034e-5, 7.874e-5, 1.1579e-4),
        (-1.9e-7, 1.2e-7, 1.01e-6),
    ),
}
OP3_BODY = cad(
    1349.28,
    (-15.01, 0.13, 65.82),
    (3.40499e-3, 2.96939e-3, 3.17331e-3),
    (5.72e-6, -4.256e-5, -5.9e-7),
)
# Each with the origin of its frame in the body's [m]: neck, then the arm from shoulder to elbow.
OP3_HEAD = (
    (
        cad(11.76, (2.33, 0, 8.23), (3.97e-6, 1.65e-6, 3.87e-6), (0, -3.1e-7, 0)),
        (-0.001, 0, 0.1365),
    ),
    (
        cad(
            136.31,
            (2.30, -18.63, 27.70),
            (1.0612e-4, 8.721e-5, 4.529e-5),
            (1.1e-7, -9.10e-6, 8.4e-7),
        ),
        (0.009, 0.019, 0.1650),
    ),
)
OP3_SHOULDER = (
    cad(11.76, (0, 8.23, -2.33), (1.65e-6, 3.87e-6, 3.97e-6), (0, 0, 3.1e-7)),
    (-0.001, 0.06, 0.111),
)
OP3_LEFT_ARM = (  # As they stretch to the left at the joints' zero.
    (
        cad(
            177.58,
            (-18.44, 45.14, 0.28),
            (2.2804e-4, 3.042e-5, 2.3474e-4),
            (-1e-8, 3e-8, 5.9e-7),
        ),
        (0.018, 0.0885, 0.101),
    ),
    (
        cad(41.27, (-19.00, 70.33, 3.80), (6.196e-5, 1.231e-5, 6.854e-5), (0, 0, -3.72e-6)),
        (0.018, 0.1789, 0.1009),
    ),
)
OP3_SHOULDER_ROLL = OP3_LEFT_ARM[0][1]
HANGING = np.array(
    [[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]
)  # A quarter turn of the shoulder's roll.

OP3_TORSO_SHAPES = (
    box("body", (-0.070, -0.063, 0.006), (0.040, 0.063, 0.125), WHITE, touch=OP3_BODY_FRICTION),
    box("neck", (-0.0135, -0.021, 0.1365), (0.019, 0.021, 0.1675), BLACK),
    box("head", (-0.007, -0.047, 0.154), (0.037, 0.047, 0.2318), GREY, touch=OP3_BODY_FRICTION),
    box("face", (0.037, -0.040, 0.175), (0.0375, 0.040, 0.225), BLACK),
    disc("eye_l", "x", (0.0385, 0.020, 0.205), 0.007, 0.002, GLOW),
    disc("eye_r", "x", (0.0385, -0.020, 0.205), 0.007, 0.002, GLOW),
    box("badge", (0.040, -0.030, 0.080), (0.041, 0.030, 0.095), BLUE),
    box("vent", (0.040, -0.030, 0.040), (0.041, 0.030, 0.050), GREY),
)
OP3_LEFT_ARM_SHAPES = (
    box("shoulder", (-0.022, 0.060, 0.091), (0.020, 0.091, 0.1235), BLACK),
    box("upper_arm", (-0.020, 0.074, 0.0), (0.022, 0.104, 0.112), BLACK, touch=OP3_BODY_FRICTION),
    box("fore_arm", (-0.022, 0.073, -0.136), (0.020, 0.103, 0.0), WHITE, touch=OP3_BODY_FRICTION),
)
# In the link's own frame; the sole is the mesh's lowest face, 30.5 mm under the ankle.
OP3_LEFT_LEG_SHAPES = {
    "hip_yaw": (box("bracket", (-0.024, -0.0125, -0.031), (0.021, 0.0125, 0.0), ALUMINIUM),),
    "hip_roll": (
        box("servos", (-0.036, -0.016, -0.035), (0.043, 0.016, 0.011), BLACK, OP3_BODY_FRICTION),
    ),
    "hip_pitch": (
        box("thigh", (-0.015, -0.042, -0.121), (0.016, 0.004, 0.002), ALUMINIUM, OP3_BODY_FRICTION),
        box("thigh_cover", (0.016, -0.034, -0.100), (0.020, -0.004, -0.030), WHITE),
    ),
    "knee": (
        box("shin", (-0.015, -0.042, -0.112), (0.015, 0.002, 0.002), ALUMINIUM, OP3_BODY_FRICTION),
        box("shin_cover", (0.015, -0.035, -0.100), (0.019, -0.005, -0.020), WHITE),
    ),
    "ank_pitch": (box("servos", (-0.060, -0.035, -0.011), (0.019, -0.003, 0.035), BLACK),),
    "ank_roll": (
        box(
            "sole",
            (-0.0395, -0.0265, -0.0305),
            (0.0875, 0.0515, -0.0225),
            GREY,
            touch=surface_friction(OP3_PAIR_FRICTION),
        ),
        box("bracket", (-0.015, -0.015, -0.0225), (0.050, 0.015, 0.0025), ALUMINIUM),
    ),
}

OP3_COMMENTS = (
    "Written by tools/make_models.py: the ROBOTIS OP3, with the sources of its figures there.",
    """
    A joint turns by its sign times the KHR-3HV's angle, in which a hip and an ankle flex, a knee
    bends and rolls lean the legs to the right where positive:

              hip_roll  hip_pitch  knee  ank_pitch  ank_roll
      l_         -1        -1       +1      +1         -1
      r_         -1        +1       -1      -1         -1

    The hips' yaw is held at 0. Stand with hips 12, knees 30, ankles 18 degrees.
    Servo: XM430-W350 at 12.0 V, no-load speed 4.82 rad/s.
  """,
)


def op3_part(mass: Mass, origin: Vector, turn: np.ndarray | None = None) -> Mass:
    """One link in the upright robot's frame, about whose origin it was turned at first."""
    turn = np.eye(3) if turn is None else turn
    place = np.add(origin, (0.0, 0.0, OP3_BODY_HEIGHT))
    return Mass(mass=mass.mass, com=place + turn @ mass.com, inertia=turn @ mass.inertia @ turn.T)


def symmetrical(part: Mass) -> Mass:
    """The mean of a part and its mirror image."""
    return combined([part.scaled(0.5), mirrored(part).scaled(0.5)])


def op3_torso() -> Mass:
    """Body, head and hanging arms."""
    arm = [op3_part(*OP3_SHOULDER)]
    for part, origin in OP3_LEFT_ARM:
        reach = HANGING @ np.subtract(origin, OP3_SHOULDER_ROLL)
        arm.append(op3_part(part, tuple(np.add(OP3_SHOULDER_ROLL, reach)), HANGING))
    trunk = [op3_part(OP3_BODY, (0.0, 0.0, 0.0)), *(op3_part(*part) for part in OP3_HEAD)]
    return combined([symmetrical(combined(trunk)), *arm, *(mirrored(part) for part in arm)])


def moved(shape: Shape, origin: np.ndarray) -> Shape:
    """A shape that is given in the frame at `origin`, in the upright robot's."""
    lower, upper = np.add(shape.lower, origin), np.add(shape.upper, origin)
    return replace(shape, lower=tuple(lower), upper=tuple(upper))


def op3_sdf() -> str:
    """The ROBOTIS OP3 as SDF text."""
    root, model = new_model("op3", *OP3_COMMENTS)
    base = np.array([0.0, 0.0, OP3_BODY_HEIGHT])
    shapes = [moved(shape, base) for shape in OP3_TORSO_SHAPES]
    for shape in OP3_LEFT_ARM_SHAPES:
        left = moved(replace(shape, name=f"{shape.name}_l"), base)
        shapes += [left, mirrored_shape(left, f"{shape.name}_r")]
    add_link(model, "body_link", base, op3_torso(), shapes)
    links = ["body_link"]
    for side, mirror in (("r", -1.0), ("l", 1.0)):
        place, above = base, "body_link"
        for joint, offset, left_axis, right_axis in OP3_JOINTS:
            name = f"{side}_{joint}"
            place = place + np.array(offset) * (1.0, mirror, 1.0)
            on_left = place * (1.0, mirror, 1.0)
            part = OP3_LEFT_LEG[joint]
            mass = Mass(mass=part.mass, com=part.com + on_left, inertia=part.inertia)
            looks = [moved(shape, on_left) for shape in OP3_LEFT_LEG_SHAPES[joint]]
            if side == "r":
                mass = mirrored(mass)
                looks = [mirrored_shape(shape, shape.name) for shape in looks]
            add_link(model, f"{name}_link", place, mass, looks)
            axis = left_axis if side == "l" else right_axis
            hinge_of, hinge = add_hinge(model, name, above, f"{name}_link", axis)
            add_limit(hinge, -OP3_RANGE, OP3_RANGE, OP3_STALL_TORQUE)
            element(hinge, "dynamics")
            add_rotor(hinge_of, OP3_ROTOR_INERTIA)
            above = f"{name}_link"
            links.append(above)
    return written(root, model, links)


MODEL_FILES: dict[str, Callable[[], str]] = {
    "khr3hv.sdf": lambda: sdf(
        raised_masses(),
        "Written by tools/make_models.py: the KHR-3HV with its centre of mass at 245.0 mm.",
    ),
    "khr3hv_cad.sdf": lambda: sdf(
        cad_masses(),
        "Written by tools/make_models.py: the KHR-3HV with its CAD model's own masses.",
    ),
    "op3.sdf": op3_sdf,
}


def main() -> None:
    """Write all files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=MODELS, help="folder (default: models/)")
    folder = parser.parse_args().out
    for name, text in MODEL_FILES.items():
        (folder / name).write_text(text())
        print(f"wrote {folder / name}")


if __name__ == "__main__":
    main()
