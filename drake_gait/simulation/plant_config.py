"""All that a plant is made from."""

from dataclasses import dataclass, field

from drake_gait.foot import FootDesign
from drake_gait.robot.description import Model
from drake_gait.servo import Servo
from drake_gait.sole import Contact, Sole
from drake_gait.walk import DEFAULT_MODEL


@dataclass(frozen=True, kw_only=True)
class PlantConfig:
    """A robot on the ground: equal ones make equal plants, and share one where it is kept."""

    model: Model = DEFAULT_MODEL
    """Robot description."""
    foot: FootDesign | None = field(default_factory=FootDesign)
    """Its toes; None: those of the description."""
    servo: Servo = field(default_factory=Servo)
    """Its ten servos."""
    sole: Sole = Sole.AREA
    """What touches the ground under its feet."""
    contact: Contact | None = None
    """Size and softness of the sole; None: the sole's own."""
    friction: float = 1.0
    """Factor on every coefficient of friction between the feet and the ground."""
    voltage: float = 1.0
    """Factor on the supply voltage: on the stall torque and on the no-load speed."""
    time_step: float = 0.0
    """Of Drake's discrete plant with its lagged solver [s]; 0: a continuous plant."""

    @property
    def supply(self) -> float:
        """Return supply voltage / rated voltage of the servos."""
        return self.voltage * self.servo.voltage
