"""The foot's design: what a toe study may change (paper, II.B)."""

import math
from dataclasses import dataclass

from drake_gait.errors import SettingsError
from drake_gait.ranges import Range, Unit, check

N_MM_PER_DEG = 1e-3 * 180.0 / math.pi
"""One N·mm/deg in N·m/rad."""

DESIGN_LIMITS = {
    "big_toe_stiffness": (0.02 * N_MM_PER_DEG, 5.0 * N_MM_PER_DEG),
    "lesser_toes_stiffness": (0.02 * N_MM_PER_DEG, 5.0 * N_MM_PER_DEG),
    "toe_damping": (1.0e-5, 1.0e-2),
    "big_toe_width": (0.008, 0.050),
    "toe_length": (0.010, 0.034),
}
"""Smallest and largest value of each design variable, in its unit."""

DESIGN_UNITS = {
    "big_toe_stiffness": "N·m/rad",
    "lesser_toes_stiffness": "N·m/rad",
    "toe_damping": "N·m·s/rad",
    "big_toe_width": "m",
    "toe_length": "m",
}
"""Their units."""

SIZES = frozenset({"big_toe_width", "toe_length"})
"""Those of which a robot is built anew."""

SEARCHED_IN_LOG = frozenset({"big_toe_stiffness", "lesser_toes_stiffness", "toe_damping"})
"""Those that span decades, where a factor counts; the sizes are searched as they are."""


@dataclass(frozen=True, kw_only=True)
class FootDesign:
    """Two passive spring toes side by side, alike on both feet. Defaults are the paper's foot.

    Whatever the toes are, the outline of the foot stays, which the robot's file tells.
    """

    big_toe_stiffness: float = 0.52 * N_MM_PER_DEG
    """Torsion spring of the big toe [N·m/rad]."""
    lesser_toes_stiffness: float = 0.26 * N_MM_PER_DEG
    """Torsion spring of the lesser toes [N·m/rad]."""
    toe_damping: float = 2.0e-4
    """Damping of each toe hinge [N·m·s/rad]; the paper gives none."""
    big_toe_width: float = 0.022
    """Width of the big toe [m]; the lesser toes take the rest of the foot."""
    toe_length: float = 0.028
    """From the hinges of both toes to their tips [m]; the heel part takes the rest of the foot."""
    rigid_toes: bool = False
    """Whether the toes are one with the heel part, for comparison; springs do nothing then."""

    def __post_init__(self) -> None:
        for name, (lower, upper) in DESIGN_LIMITS.items():
            allowed = Range(lower=lower, upper=upper)
            check(name, getattr(self, name), allowed, Unit(name=DESIGN_UNITS[name]))
        if not isinstance(self.rigid_toes, bool):
            raise SettingsError(f"rigid_toes must be true or false, got {self.rigid_toes!r}")

    @property
    def body(self) -> "FootDesign":
        """The same shapes and hinges on the paper's springs: what a robot is built for."""
        return FootDesign(
            big_toe_width=self.big_toe_width,
            toe_length=self.toe_length,
            rigid_toes=self.rigid_toes,
        )
