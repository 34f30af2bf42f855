"""The foot's design: what a toe study may change (paper, II.B)."""

import math
from dataclasses import dataclass, fields

from drake_gait.errors import SettingsError

N_MM_PER_DEG = 1e-3 * 180.0 / math.pi
"""One N·mm/deg in N·m/rad."""

FOOT_WIDTH = 0.078
"""Width of the whole foot [m]."""
TOE_GAP = 0.001
"""Gap between big toe and lesser toes [m]."""

DESIGN_LIMITS = {
    "big_toe_stiffness": (0.02 * N_MM_PER_DEG, 5.0 * N_MM_PER_DEG),
    "lesser_toes_stiffness": (0.02 * N_MM_PER_DEG, 5.0 * N_MM_PER_DEG),
    "toe_damping": (1.0e-5, 1.0e-2),
    "big_toe_width": (0.008, 0.050),
}
"""Smallest and largest value of each field of FootDesign, in its unit."""

DESIGN_UNITS = {
    "big_toe_stiffness": "N·m/rad",
    "lesser_toes_stiffness": "N·m/rad",
    "toe_damping": "N·m·s/rad",
    "big_toe_width": "m",
}
"""Their units."""


@dataclass(frozen=True, kw_only=True)
class FootDesign:
    """Two passive spring toes side by side, alike on both feet. Defaults are the paper's foot."""

    big_toe_stiffness: float = 0.52 * N_MM_PER_DEG
    """Torsion spring of the big toe [N·m/rad]."""
    lesser_toes_stiffness: float = 0.26 * N_MM_PER_DEG
    """Torsion spring of the lesser toes [N·m/rad]."""
    toe_damping: float = 2.0e-4
    """Damping of each toe hinge [N·m·s/rad]; the paper gives none."""
    big_toe_width: float = 0.022
    """Width of the big toe [m]; the lesser toes take the rest of the foot less TOE_GAP."""

    def __post_init__(self) -> None:
        for field in fields(self):
            lower, upper = DESIGN_LIMITS[field.name]
            value = getattr(self, field.name)
            if not lower <= value <= upper:
                raise SettingsError(
                    f"{field.name} must lie in {lower:.4g} to {upper:.4g} "
                    f"{DESIGN_UNITS[field.name]}, got {value}"
                )

    @property
    def lesser_toes_width(self) -> float:
        """Width left for the lesser toes [m]."""
        return FOOT_WIDTH - self.big_toe_width - TOE_GAP
