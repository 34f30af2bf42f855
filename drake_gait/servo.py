"""The position servos of the ten leg joints."""

import math
from dataclasses import dataclass, fields

from drake_gait.ranges import Range, check

_RANGE = Range(lower=0.0, upper=1e6, open=True)

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
    """

    stiffness: float = 20.0
    """Proportional gain [N·m/rad]: the stall torque is reached 3.9 degrees off the command."""
    damping: float = 0.2
    """Damping by the controller [N·m·s/rad]."""
    no_load_speed: float = 7.48
    """Speed at which the motor has no torque left [rad/s]: 0.14 s/60 degrees, KRS-2552 data."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            check(f"servo {field.name}", value, _RANGE)
