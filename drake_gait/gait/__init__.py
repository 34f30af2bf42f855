"""Gaits: numbers to joint angle commands."""

from drake_gait.gait.paper import (
    ANGLE_LIMITS,
    ANGULAR_VELOCITY,
    CYCLE_TIME,
    FRAME_TIME,
    FRAMES,
    JOINTS,
    STANDING,
    TERMS,
    WALKING,
    WAVEFORMS,
    FloatArray,
    Gait,
    Start,
    joint_commands,
)

__all__ = [
    "ANGLE_LIMITS",
    "ANGULAR_VELOCITY",
    "CYCLE_TIME",
    "FRAMES",
    "FRAME_TIME",
    "JOINTS",
    "STANDING",
    "TERMS",
    "WALKING",
    "WAVEFORMS",
    "FloatArray",
    "Gait",
    "Start",
    "joint_commands",
]
