"""The position servos of the ten leg joints."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drake_gait.ranges import DEGREES, MS, NONE, RAD_PER_S, Range, Unit, check

_Array = NDArray[np.float64]

_POSITIVE = Range(lower=0.0, upper=1e6, open=True)
_LONGEST_DELAY = 0.1  # s
_RANGES = {
    "coulomb_friction": (Range(lower=0.0, upper=10.0), Unit(name="N·m")),
    "load_friction": (Range(lower=0.0, upper=0.9), NONE),
    "backlash": (Range(lower=0.0, upper=math.radians(10.0)), DEGREES),
    "delay": (Range(lower=0.0, upper=_LONGEST_DELAY), MS),
    "voltage": (Range(lower=0.5, upper=2.0), NONE),
}
"""What a field may be, with the unit that a message has it in; others are above 0."""

KEYS: Mapping[str, tuple[str, Unit]] = MappingProxyType(
    {
        "stiffness_n_m_per_rad": ("stiffness", Unit(name="N·m/rad")),
        "damping_n_m_s_per_rad": ("damping", Unit(name="N·m·s/rad")),
        "no_load_speed_rad_per_s": ("no_load_speed", RAD_PER_S),
        "coulomb_friction_n_m": ("coulomb_friction", Unit(name="N·m")),
        "load_friction": ("load_friction", NONE),
        "backlash_deg": ("backlash", DEGREES),
        "delay_ms": ("delay", MS),
        "voltage": ("voltage", NONE),
    }
)
"""Keys of [servo] in a file, with the field that each sets and the unit that it is in."""

CREEP = 0.005
"""Speed below which dry friction grows in proportion to the speed [rad/s]: 0.3 degrees/s."""

TRAVEL = math.radians(135.0)
"""How far a servo turns to either side of its middle [rad]: 270 degrees in all, KRS-2552 data."""


@dataclass(frozen=True, kw_only=True)
class Servo:
    """A position servo: a proportional-derivative controller driving a direct-current motor.

    The controller's torque is held within the stall torque. The motor's back-EMF takes from it in
    proportion to the speed, and at the no-load speed nothing is left. This is the torque-speed line
    of the motor, with the speed limit as its end. The stall torque is the joint's effort limit in
    the robot's SDF file. A servo is sent positions, so its damping acts on its own speed. Drake
    1.51.1's CENIC would also take a desired speed, but with the wrong sign.

        torque = clip(stiffness * (q_d - q) - damping * v, ± stall) - stall * v / no_load

    This is an ideal servo. Friction, backlash and delay make it a real one; they are off by
    default. Friction takes from the torque of the motor, and never drives:

        torque = motor - (coulomb_friction + load_friction * |motor|) * clip(v / CREEP, ± 1)
    """

    stiffness: float = 20.0
    """Proportional gain [N·m/rad]: the stall torque is reached 3.9 degrees off the command."""
    damping: float = 0.2
    """Damping by the controller [N·m·s/rad]."""
    no_load_speed: float = 7.48
    """Speed at which the motor has no torque left [rad/s]: 0.14 s/60 degrees, KRS-2552 data."""
    coulomb_friction: float = 0.0
    """Dry friction of the gear without load [N·m].

    K_c in model M1 of Duclusaud et al., "Extended Friction Models for the Physics Simulation of
    Servo Actuators", ICRA 2025 (BAM).
    """
    load_friction: float = 0.0
    """Dry friction of the loaded gear, as a share of the motor's torque.

    The motor's part of the load-dependent term in model M5 (ibid.). Friction by the load outside,
    which is a term of its own there, is left out: it is not known before a step is made.
    """
    backlash: float = 0.0
    """Play between servo and joint, from end to end [rad].

    Within it the controller's spring does not act, see `engaged`.
    """
    delay: float = 0.0
    """Time from a command to its effect [s]."""
    voltage: float = 1.0
    """Supply voltage / rated voltage: factor on the stall torque and on the no-load speed.

    Both are proportional to it in a motor of constant resistance and torque constant.
    """

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            allowed, unit = _RANGES.get(field.name, (_POSITIVE, NONE))
            # In a file's unit, as `reading` tells it; programs have SI units.
            si = Unit(name={"degrees": "rad", "ms": "s"}.get(unit.name, unit.name))
            check(f"servo {field.name}", value, allowed, si)

    @property
    def has_friction(self) -> bool:
        """True where dry friction acts."""
        return self.coulomb_friction > 0.0 or self.load_friction > 0.0

    def engaged(self, error: Any) -> Any:
        """Return the part of an error of the angle [rad] that winds up the controller's spring.

        The joint is free within its play. The servo's side of it is taken to follow the command at
        once, without a shock where the play ends.
        """
        if self.backlash == 0.0:
            return error
        return error - np.clip(error, -0.5 * self.backlash, 0.5 * self.backlash)

    def back_emf(self, stall: _Array, supply: float = 1.0) -> _Array:
        """Return the torque that a motor loses for each rad/s [N·m·s/rad].

        Args:
            stall: Stall torque of each motor at that supply [N·m], any shape.
            supply: Supply voltage / rated voltage.
        """
        lost: _Array = stall / (supply * self.no_load_speed)
        return lost

    def controller_torque(self, error: Any, speed: Any, stall: _Array) -> _Array:
        """Return the torque that the controller asks of the motor [N·m].

        Args:
            error: What winds up its spring, see `engaged` [rad], any shape.
            speed: Speed of the joint [rad/s], the same shape.
            stall: Stall torque [N·m], of a shape that goes with the others.
        """
        asked = self.stiffness * error - self.damping * speed
        held: _Array = np.clip(asked, -stall, stall)
        return held

    def motor_torque(self, controller: _Array, speed: Any, back_emf: _Array) -> _Array:
        """Return the torque of the motor, its back-EMF taken off [N·m].

        Args:
            controller: What the controller asks for [N·m], any shape.
            speed: Speed of the joint [rad/s], the same shape.
            back_emf: See `back_emf` [N·m·s/rad], of a shape that goes with the others.
        """
        found: _Array = controller - back_emf * speed
        return found

    def joint_torque(self, motor: _Array, speed: _Array) -> _Array:
        """Return the torque on the joint: the motor's less dry friction [N·m].

        Args:
            motor: Torque of the motor, the back-EMF taken off [N·m], any shape.
            speed: Speed of the joint [rad/s], the same shape.
        """
        return motor + self.friction_torque(motor, speed) if self.has_friction else motor

    def friction_limit(self, motor: _Array) -> _Array:
        """Return the most that dry friction can hold [N·m].

        Args:
            motor: Torque of the motor, the back-EMF taken off [N·m], any shape.
        """
        limit: _Array = self.coulomb_friction + self.load_friction * np.abs(motor)
        return limit

    def friction_torque(self, motor: _Array, speed: _Array) -> _Array:
        """Return the torque of dry friction on a joint [N·m].

        Args:
            motor: Torque of the motor, the back-EMF taken off [N·m], any shape.
            speed: Speed of the joint [rad/s], the same shape.
        """
        return -self.friction_limit(motor) * np.clip(speed / CREEP, -1.0, 1.0)
