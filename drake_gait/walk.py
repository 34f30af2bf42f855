"""The walk: settings of a simulation, and its results."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from drake_gait.errors import SettingsError
from drake_gait.gait import FRAME_TIME, FRAMES, JOINTS, STANDING, FloatArray, Schedule, Start
from drake_gait.ranges import POSITIVE, Range, Unit, check, choice
from drake_gait.servo import Servo
from drake_gait.sole import Contact, Sole

if TYPE_CHECKING:
    from drake_gait.robot.description import RobotModel

DEFAULT_MODEL = "khr3hv.sdf"
"""The shipped model that walks when none is named."""
DEFAULT_ROBOT = "khr3hv.toml"
"""The shipped robot's file of every model that comes without one."""


class Fidelity(StrEnum):
    """Fineness of a simulation; the plant is the same."""

    SEARCH = "search"
    """CENIC at a fixed step of 4 ms, or `WalkSettings.step`: fast enough for thousands of walks."""
    REFERENCE = "reference"
    """CENIC at a fixed step of 1 ms: what a finalist is confirmed with.

    On boxes, as before there were other soles, with error control at 1e-4.
    """


class Engine(StrEnum):
    """Engine that simulates a walk."""

    DRAKE = "drake"
    """Drake, for which the contact was chosen."""
    MUJOCO = "mujoco"
    """MuJoCo, with the same robot: a second opinion."""


@dataclass(frozen=True, kw_only=True)
class Integrator:
    """Time steps of a simulation in Drake."""

    step: float
    """Length of every step, or the longest where errors are controlled [s]."""
    accuracy: float | None = None
    """Error per step that is allowed, CENIC's measure; None: steps of fixed length."""
    discrete: bool = False
    """Whether to use Drake's discrete plant with its lagged solver; for comparisons."""

    def __post_init__(self) -> None:
        if not 0.0 < self.step <= FRAME_TIME:
            raise SettingsError(f"step must be > 0 and <= {FRAME_TIME} s, got {self.step}")
        if self.accuracy is not None and not 0.0 < self.accuracy < 1.0:
            raise SettingsError(f"accuracy must be in (0, 1), got {self.accuracy}")

    @property
    def lead(self) -> float:
        """Time by which a command is read ahead [s].

        Drake reads it at the beginning of a step and applies it at the end. In steps of fixed
        length this makes up for the delay.
        """
        return self.step if self.accuracy is None else 0.0

    @property
    def fixed(self) -> bool:
        """Return whether all steps are equally long and of the engine's own kind."""
        return self.accuracy is None and not self.discrete


def _equal_steps(longest: float) -> Integrator:
    """Equal steps of a frame: the sliver that is left of it otherwise has no solution."""
    return Integrator(step=FRAME_TIME / math.ceil(FRAME_TIME / longest - 1e-9))


SEARCH_STEP = 0.004
"""Step of the search where none is named [s] (docs/experiments/2026-11-27-soles.md)."""
_LONGEST_IN_MUJOCO = 0.001
"""Of MuJoCo's steps, whose forces are those of their beginnings [s]."""
_REFERENCE = Integrator(step=0.001)
_REFERENCE_ON_BOXES = Integrator(step=FRAME_TIME, accuracy=1e-4)


MOST_DELAY = 0.1
"""Longest delay of commands [s]."""


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Difference of a robot from its description."""

    joint_zeros: tuple[float, ...] = (0.0,) * 10
    """Where each servo has its zero, added to its commands [rad], ordered as gait.JOINTS."""
    voltage: float = 1.0
    """Factor on the supply voltage: on the stall torque and on the no-load speed."""
    mass: float = 1.0
    """Factor on the mass and the inertia of every link."""
    delay: float = 0.0
    """Time by which every command is late [s]."""

    def __post_init__(self) -> None:
        if len(self.joint_zeros) != len(JOINTS):
            raise SettingsError(
                f"joint_zeros must be {len(JOINTS)} angles [rad], got {len(self.joint_zeros)}"
            )
        for zero in self.joint_zeros:
            check("joint_zeros", zero, Range(lower=-0.1, upper=0.1), Unit(name="rad"))
        check("voltage", self.voltage, Range(lower=0.5, upper=2.0))
        check("mass", self.mass, Range(lower=0.5, upper=2.0))
        check("delay", self.delay, Range(lower=0.0, upper=MOST_DELAY), Unit(name="s"))


@dataclass(frozen=True, kw_only=True)
class WalkSettings:
    """Settings of the simulation of a candidate."""

    model: "str | Path | RobotModel" = DEFAULT_MODEL
    """Robot: its file (.toml) or a model, by path or by a shipped name, or one that was read.

    A model alone is an edited KHR-3HV.
    """
    robot: str | Path = ""
    """The robot's file that tells of another `model` than its own."""
    engine: Engine = Engine.DRAKE
    """What simulates; MuJoCo needs the extra of its name."""
    fidelity: Fidelity = Fidelity.SEARCH
    """How finely to simulate; MuJoCo has one fidelity."""
    step: float = SEARCH_STEP
    """Longest step of the search fidelity [s]; a frame has equal ones. In MuJoCo at most 1 ms."""
    sole: Sole = Sole.AREA
    """What touches the ground under the feet."""
    contact: Contact | None = None
    """Takes the place of the soles' own size and softness; for comparisons."""
    start: Start = Start.RAMP
    """How a gait of the paper's family begins; others have a start of their own."""
    integrator: Integrator | None = None
    """Takes the place of the fidelity's own; for comparisons."""
    servo: Servo | None = None
    """Servos of all joints; None: those of the robot's file, see `robot.description.servo_of`."""
    friction: float = 1.0
    """Factor on every coefficient of friction between the feet and the ground."""
    disturbance: Disturbance | None = None
    """How the robot differs from its description."""
    time_limit: float = 60.0
    """Computing time after which a walk is given up as diverged [s]."""

    def __post_init__(self) -> None:
        # A member may be given by its value, as a file names it.
        kinds = {"engine": Engine, "fidelity": Fidelity, "sole": Sole, "start": Start}
        for name, kind in kinds.items():
            object.__setattr__(self, name, choice(kind, name, getattr(self, name)))
        if not self.time_limit > 0.0:  # Infinity is a limit too.
            check("time_limit", self.time_limit, POSITIVE, Unit(name="s"))
        check("friction", self.friction, Range(lower=0.05, upper=2.25))
        check("step", self.step, Range(lower=1e-4, upper=FRAME_TIME), Unit(name="s"))
        if self.engine is Engine.MUJOCO and not self.stepping.fixed:
            raise SettingsError(
                "integrator must have steps of fixed length in MuJoCo, without accuracy and not "
                f"discrete, got {self.integrator}"
            )

    @property
    def delay(self) -> float:
        """Time by which the servos act on every command late [s]."""
        parts = (self.servo, self.disturbance)
        return sum(part.delay for part in parts if part is not None)

    @property
    def stepping(self) -> Integrator:
        """The integrator to use."""
        if self.integrator is not None:
            return self.integrator
        if self.engine is Engine.MUJOCO:
            return _equal_steps(min(self.step, _LONGEST_IN_MUJOCO))
        if self.fidelity is Fidelity.SEARCH:
            return _equal_steps(self.step)
        return _REFERENCE_ON_BOXES if self.sole is Sole.BOXES else _REFERENCE


class Outcome(StrEnum):
    """End of a walk."""

    WALKED = "walked"
    """All frames of the gait on its feet."""
    FELL = "fell"
    """The torso tilted or sank past the fall criterion."""
    DIVERGED = "diverged"
    """The solver, the process or the wall clock gave up; `Walk.reason` says which."""


@dataclass(frozen=True, kw_only=True, eq=False)
class History:
    """Time histories of a walk at its n control frames, world frame (x forward, y left, z up)."""

    time: FloatArray
    """Time of each frame [s], shape (n,)."""
    positions: FloatArray
    """Positions of the plant, which a recording replays: (n, 21), (n, 17) with rigid toes."""
    com: FloatArray
    """Centre of mass p_WC [m], shape (n, 3)."""
    torso: FloatArray
    """Torso origin p_WT [m] and roll, pitch, yaw [rad], shape (n, 6)."""
    ankles: FloatArray
    """Origins of the right and the left ankle link [m], shape (n, 2, 3)."""
    commands: FloatArray
    """Commanded joint angles [rad], shape (n, 10), columns as gait.JOINTS."""
    angles: FloatArray
    """Measured joint angles [rad], shape (n, 10), as commands; NaN of joints that it has not.

    They are counted as a gait counts them: from the standing pose, in the KHR-3HV's signs.
    """
    speeds: FloatArray
    """Joint speeds [rad/s], shape (n, 10)."""
    torques: FloatArray
    """Torques of the servos on their joints [N·m], shape (n, 10)."""
    toes: FloatArray
    """Toe angles [rad], shape (n, 4): right big, right lesser, left big, left lesser.

    NaN of toes that the robot has not.
    """
    ground_reaction: FloatArray
    """Force of the ground on the right and the left foot with its toes [N], shape (n, 2, 3)."""
    sole_height: FloatArray
    """Height of the lowest point of the right and the left foot [m], shape (n, 2)."""
    schedule: Schedule = STANDING.schedule
    """The gait's cycle and frames; the paper's by default."""


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Cost and manner of a walk. Pairs are right foot, left foot."""

    energy: float
    """Mechanical work of the ten servos on their joints, driving and braking [J]."""
    positive_energy: float
    """The driving part of it alone [J]: a servo does not recover what it brakes."""
    cost_of_transport: float
    """Positive energy / (weight x distance walked forward); infinite without advance."""
    peak_torque: float
    """Largest torque of a servo on its joint [N·m]."""
    peak_speed: float
    """Largest speed of a servo [rad/s]."""
    saturated_fraction: float
    """Share of servo-time in which the controller asks for the stall torque."""
    slip: tuple[float, float]
    """Distance that the loaded sole slides over the ground [m]."""
    clearance: tuple[float, float]
    """Minimum toe clearance in the lowest of the foot's swings [m]; 0 without a swing."""
    duty_factor: tuple[float, float]
    """Share of the second cycle in which the foot carries load."""
    peak_ground_reaction: float
    """Largest vertical force of the ground, mean of a frame of 20 ms / weight."""
    toe_range: tuple[float, float, float, float]
    """Largest angle of each toe [rad]: right big, right lesser, left big, left lesser."""
    torso_tilt: float
    """Largest lean of the torso from upright [rad]."""
    # Walks of older studies lack these.
    driving_torque: float = math.nan
    """Largest torque of a servo that drives its joint [N·m]."""
    braking_torque: float = math.nan
    """Largest torque of a servo that its joint drives back [N·m]."""
    driving_speed: float = math.nan
    """Largest speed of a servo that drives its joint [rad/s]."""
    braking_speed: float = math.nan
    """Largest speed of a servo that its joint drives back [rad/s]."""
    line_share: float = math.nan
    """Largest torque / stall torque + speed / no-load speed of a motor that drives its joint."""


_CAUSES = {
    "solver": ("solver", "the state is not finite"),
    "worker died": ("its process died", "its Dask workers died", "its process was stopped"),
    "time limit": ("took longer than", "gave no sign for"),
}
"""How the reasons of walks that diverged begin, by cause."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Walk:
    """One simulated walk: the paper's quantities in SI units, from the first to the last frame."""

    outcome: Outcome
    """How the walk ended."""
    frames: int
    """Control frames completed before the robot fell: N, at most `planned`."""
    forward: float
    """Displacement of the centre of mass along world x [m]: Z_f."""
    lateral: float
    """The same along world y, left positive [m]: X_f."""
    yaw: float
    """Rotation of the torso about world z, unwrapped [rad]: R_f."""
    com_height: float
    """Height of the centre of mass above the ground in the last frame [m]: Y_f."""
    yaw_swing: float | None = None
    """Range of the torso's heading [rad]; None of a walk that diverged, or of an older study."""
    reason: str = ""
    """Why the walk ended early; empty when it did not."""
    history: History | None = field(default=None, repr=False)
    """Time histories, when asked for."""
    measures: Measures | None = None
    """Energy, slip and the like; None of a walk that diverged, or of an older study."""
    values: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Quantities that nothing else here tells, by name [SI], one value for each part."""
    planned: int = FRAMES
    """Frames of the gait; the paper's has 240."""

    @property
    def survived(self) -> bool:
        """Return whether the robot was on its feet to the end."""
        return self.outcome is Outcome.WALKED

    @property
    def failure(self) -> str | None:
        """Return the cause of its early end, in a word or two to count by; None without one."""
        if self.outcome is not Outcome.DIVERGED:
            return None if self.survived else str(self.outcome)
        for cause, beginnings in _CAUSES.items():
            if self.reason.startswith(beginnings):
                return cause
        return "lost"

    @classmethod
    def diverged(cls, reason: str, frames: int = 0) -> "Walk":
        """The stated numbers of a walk that could not be simulated to its end: all zero."""
        return cls(
            outcome=Outcome.DIVERGED,
            frames=frames,
            forward=0.0,
            lateral=0.0,
            yaw=0.0,
            com_height=0.0,
            reason=reason,
        )
