"""Settings of the networks, which load without torch."""

from dataclasses import dataclass

from drake_gait.errors import SettingsError
from drake_gait.ranges import POSITIVE, check


@dataclass(frozen=True, kw_only=True)
class NetworkSettings:
    """Size of a network, and how long it learns."""

    units: int = 32
    """Hidden units of each member."""
    epochs: int = 250
    """Passes over all walks."""
    learning_rate: float = 0.03
    """First step size of AdamW; it falls to zero along a cosine."""
    weight_decay: float = 1.0
    """Pull of the weights towards zero, as AdamW has it."""

    def __post_init__(self) -> None:
        for name in ("units", "epochs"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise SettingsError(f"network {name} must be a whole number >= 1, got {value!r}")
        check("network learning_rate", self.learning_rate, POSITIVE)
        if self.weight_decay != 0.0:
            check("network weight_decay", self.weight_decay, POSITIVE)


PAPER_NETWORK = NetworkSettings(units=20, epochs=500, weight_decay=0.0)
"""The paper's: 20 hidden units, back-propagation alone."""
