"""Optimisers that know nothing of robots: ISADE, the paper's differential evolution."""

from drake_gait.optimizers.isade import Isade, minimize

__all__ = ["Isade", "minimize"]
