"""The soles of a robot's feet: what touches the ground, and how soft the contact is."""

from dataclasses import dataclass
from enum import StrEnum

from drake_gait.errors import SettingsError
from drake_gait.ranges import POSITIVE, Unit, check


class Sole(StrEnum):
    """Shapes that touch the ground under the plates of a foot: heel, big toe and lesser toes."""

    AREA = "area"
    """A rigid rim along the edges of each plate, on a compliant half space."""
    POINTS = "points"
    """The corners of each plate."""
    BOXES = "boxes"
    """Each plate as the compliant box of the description, on a rigid half space."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """Size and softness of the soles `area` and `points`; boxes have what their description says.

    Chosen by measurement (docs/experiments/2026-11-27-soles.md); other numbers are for comparisons.
    """

    rim: float = 0.006
    """Width of the rim of `area` [m]; at most a third of a plate's length and width."""
    finer: int = 1
    """Factor on the number of faces along the edges of `area`."""
    modulus: float = 1e6
    """Hydroelastic modulus of the ground under `area` [Pa]."""
    slab: float = 0.005
    """Depth of the compliant layer of the ground under `area` [m]."""
    stiffness: float = 6e3
    """Stiffness of one of the `points` and the ground together [N/m]."""
    dissipation: float = 20.0
    """Hunt and Crossley's dissipation of both [s/m]."""

    def __post_init__(self) -> None:
        units = {"rim": "m", "modulus": "Pa", "slab": "m", "stiffness": "N/m", "dissipation": "s/m"}
        for name, unit in units.items():
            check(name, getattr(self, name), POSITIVE, Unit(name=unit))
        if isinstance(self.finer, bool) or not isinstance(self.finer, int) or self.finer < 1:
            raise SettingsError(f"finer must be a whole number >= 1, got {self.finer!r}")
