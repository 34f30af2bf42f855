"""The quantities of a walk that limits and objectives are set on."""

import math
from enum import StrEnum

from drake_gait.errors import SettingsError
from drake_gait.walk import Outcome, Walk

OUTPUTS = ("forward", "lateral", "yaw", "com_height")
"""What every network predicts: Z_f, X_f [m], R_f [rad], Y_f [m]."""

OF_EVERY_WALK = (*OUTPUTS, "yaw_swing")
"""What every walk has, with measures or without."""


def quantity(walk: Walk, name: str) -> float:
    """One number of a walk, in SI units.

    Args:
        walk: The walk.
        name: One of OF_EVERY_WALK, a field of `walk.Measures`, or "transport_efficiency", the
            inverse of the cost of transport. Of several feet or toes, the worst.

    Raises:
        SettingsError: the walk was simulated without measures.
    """
    if name in OF_EVERY_WALK:
        known = getattr(walk, name)
        return math.nan if known is None else float(known)
    if walk.outcome is Outcome.DIVERGED:
        return math.nan
    if walk.measures is None:
        raise SettingsError(f"{name} needs the measures of a walk; simulate it with measures=True")
    if name == "transport_efficiency":
        return 1.0 / walk.measures.cost_of_transport
    value = getattr(walk.measures, name)
    worst = min if name == "clearance" else max
    return float(worst(value) if isinstance(value, tuple) else value)


class Objective(StrEnum):
    """What a study wants of a walk."""

    DISTANCE = "distance"
    """The largest distance walked forward, Eq. 10."""
    COST_OF_TRANSPORT = "cost_of_transport"
    """The smallest driving work per weight and distance; the paper's future work."""

    @property
    def quantity(self) -> str:
        """Name of the quantity that is maximised, see `quantity`."""
        return "forward" if self is Objective.DISTANCE else "transport_efficiency"
