"""One walk: build the diagram, step it frame by frame, return what it left behind."""

import time
from functools import lru_cache
from pathlib import Path
from typing import cast

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import ContactResults
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Context

from drake_gait.foot import FootDesign
from drake_gait.gait import FRAME_TIME, FRAMES, JOINTS, FloatArray
from drake_gait.problem import Candidate
from drake_gait.robot import TOE_HINGES, Robot, build_robot
from drake_gait.servo import Servo
from drake_gait.walk import Fidelity, History, Outcome, Walk, WalkSettings

FALL_TILT = np.radians(45.0)
"""The robot has fallen when its torso leans further than this from upright [rad]."""
FALL_HEIGHT = 0.8
"""The robot has fallen when its torso is below this part of its standing height."""

_SETTLING_TIME = 1.0
"""How long the robot stands before its walk, to come to rest on its soles [s]."""


# A step must not miss a frame's instant by rounding: the sliver of a step that is left has no
# solution, and CENIC fails an assertion. A step this much longer is always cut at the frame.
_STEP_EXCESS = 1.0 + 1e-6

_CONFIGS = {
    Fidelity.SEARCH: SimulatorConfig(
        integration_scheme="cenic",
        max_step_size=0.004 * _STEP_EXCESS,
        use_error_control=False,
    ),
    Fidelity.REFERENCE: SimulatorConfig(
        integration_scheme="cenic",
        max_step_size=FRAME_TIME * _STEP_EXCESS,
        accuracy=1e-4,
        use_error_control=True,
    ),
}


def simulate(
    candidate: Candidate, settings: WalkSettings | None = None, *, history: bool = False
) -> Walk:
    """Walk a candidate for 4.8 s from a standing start.

    The same candidate and settings give the same numbers, bit for bit, in any process.

    Args:
        candidate: The gait, and the foot it walks on.
        settings: How to simulate; by default the shipped robot at search fidelity.
        history: Whether to record time histories at the control frames.

    Raises:
        ModelError: the robot description cannot be used.
    """
    settings = settings or WalkSettings()
    robot = _robot(settings.model, candidate.foot.big_toe_width, settings.servo)
    context = robot.diagram.CreateDefaultContext()
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, candidate.foot)
    standing = _standing(settings.model, candidate.foot, settings.servo)
    robot.plant.SetPositions(plant_context, standing)
    commands = candidate.gait.commands
    robot.gait.set_commands(robot.gait.GetMyMutableContextFromRoot(context), commands)
    recorder = _Recorder(robot, commands) if history else None
    return _advance(robot, context, settings, recorder)


@lru_cache(maxsize=4)
def _robot(model: str | Path, big_toe_width: float, servo: Servo) -> Robot:
    """One diagram serves every gait and every toe spring of a width."""
    return build_robot(model, FootDesign(big_toe_width=big_toe_width), servo)


@lru_cache(maxsize=64)
def _standing(model: str | Path, foot: FootDesign, servo: Servo) -> FloatArray:
    """Positions of the robot at rest on its soles, shape (21,)."""
    robot = _robot(model, foot.big_toe_width, servo)
    context = robot.diagram.CreateDefaultContext()
    plant_context = robot.plant.GetMyMutableContextFromRoot(context)
    robot.set_foot(plant_context, foot)
    simulator = _simulator(robot, context, Fidelity.SEARCH)
    simulator.AdvanceTo(_SETTLING_TIME)
    positions: FloatArray = robot.plant.GetPositions(plant_context)
    positions.setflags(write=False)
    return positions


def _simulator(robot: Robot, context: Context, fidelity: Fidelity) -> Simulator:
    # A fresh one for each walk: a second run in the same simulator differs in its last digits.
    simulator = Simulator(robot.diagram, context)
    ApplySimulatorConfig(_CONFIGS[fidelity], simulator)
    simulator.Initialize()
    return simulator


def _advance(
    robot: Robot, context: Context, settings: WalkSettings, recorder: "_Recorder | None"
) -> Walk:
    """Step through the frames until the end, a fall or a failure."""
    plant = robot.plant
    plant_context = plant.GetMyContextFromRoot(context)
    torso = plant.GetBodyByName("torso")
    com_start = plant.CalcCenterOfMassPositionInWorld(plant_context)
    fall_height = FALL_HEIGHT * plant.EvalBodyPoseInWorld(plant_context, torso).translation()[2]
    headings = [_heading(plant.EvalBodyPoseInWorld(plant_context, torso))]
    deadline = time.monotonic() + settings.time_limit
    outcome, reason, steps = Outcome.WALKED, "", FRAMES
    simulator = _simulator(robot, context, settings.fidelity)
    if recorder:
        recorder.record(context)
    for frame in range(1, FRAMES + 1):
        try:
            simulator.AdvanceTo(frame * FRAME_TIME)
        # Drake raises a failed assertion of its solver as SystemExit.
        except (RuntimeError, SystemExit) as error:
            return Walk.diverged(f"solver: {str(error).splitlines()[0]}", steps=frame - 1)
        if recorder:
            recorder.record(context)
        X_WT = plant.EvalBodyPoseInWorld(plant_context, torso)
        headings.append(_heading(X_WT))
        if _has_fallen(X_WT, fall_height):
            outcome, steps = Outcome.FELL, frame - 1
            reason = f"fell at {frame * FRAME_TIME:.2f} s"
            break
        if time.monotonic() > deadline:
            return Walk.diverged(f"took longer than {settings.time_limit:g} s", steps=frame)
    com_end = plant.CalcCenterOfMassPositionInWorld(plant_context)
    if not np.isfinite(com_end).all():
        return Walk.diverged("the state is not finite", steps=steps)
    return Walk(
        outcome=outcome,
        steps=steps,
        forward=float(com_end[0] - com_start[0]),
        lateral=float(com_end[1] - com_start[1]),
        yaw=float(np.unwrap(headings)[-1] - headings[0]),
        com_height=float(com_end[2]),
        reason=reason,
        history=recorder.history() if recorder else None,
    )


def _heading(X_WT: RigidTransform) -> float:
    """Angle of the torso's forward axis about world z [rad]."""
    forward = X_WT.rotation().col(0)
    return float(np.arctan2(forward[1], forward[0]))


def _has_fallen(X_WT: RigidTransform, fall_height: float) -> bool:
    upright = X_WT.rotation().col(2)[2]
    # Written so that a state that is not a number counts as a fall.
    return not (upright > np.cos(FALL_TILT) and X_WT.translation()[2] > fall_height)


class _Recorder:
    """Collects a History, frame by frame."""

    def __init__(self, robot: Robot, commands: FloatArray) -> None:
        self._robot = robot
        self._commands = commands
        plant = robot.plant
        self._torso = plant.GetBodyByName("torso")
        self._ankles = [plant.GetBodyByName(f"ankle_{side}") for side in ("r", "l")]
        joints = [plant.GetJointByName(name) for name in JOINTS]
        toes = [plant.GetJointByName(name) for name in TOE_HINGES]
        self._joint_positions = [joint.position_start() for joint in joints]
        self._joint_velocities = [joint.velocity_start() for joint in joints]
        self._toe_positions = [joint.position_start() for joint in toes]
        self._back_emf = np.array([joint.default_damping_vector()[0] for joint in joints])
        self._feet = [
            {
                geometry
                for link in ("foot", "big_toe", "lesser_toes")
                for geometry in plant.GetCollisionGeometriesForBody(
                    plant.GetBodyByName(f"{link}_{side}")
                )
            }
            for side in ("r", "l")
        ]
        self._frames: list[dict[str, FloatArray]] = []

    def record(self, context: Context) -> None:
        """Take one frame from the diagram's context."""
        plant = self._robot.plant
        plant_context = plant.GetMyContextFromRoot(context)
        positions = plant.GetPositions(plant_context)
        speeds = plant.GetVelocities(plant_context)[self._joint_velocities]
        X_WT = plant.EvalBodyPoseInWorld(plant_context, self._torso)
        controller = plant.get_net_actuation_output_port().Eval(plant_context)
        contacts = plant.get_contact_results_output_port().Eval(plant_context)
        self._frames.append(
            {
                "time": np.array(context.get_time()),
                "positions": positions,
                "com": plant.CalcCenterOfMassPositionInWorld(plant_context),
                "torso": np.concatenate(
                    [X_WT.translation(), RollPitchYaw(X_WT.rotation()).vector()]
                ),
                "ankles": np.array(
                    [
                        plant.EvalBodyPoseInWorld(plant_context, ankle).translation()
                        for ankle in self._ankles
                    ]
                ),
                "commands": self._commands[len(self._frames)],
                "angles": positions[self._joint_positions],
                "speeds": speeds,
                "torques": controller - self._back_emf * speeds,
                "toes": positions[self._toe_positions],
                "ground_reaction": self._ground_reaction(cast(ContactResults, contacts)),
            }
        )

    def _ground_reaction(self, contacts: ContactResults) -> FloatArray:
        """Force on each foot [N], shape (2, 3)."""
        forces = np.zeros((2, 3))
        for index in range(contacts.num_hydroelastic_contacts()):
            contact = contacts.hydroelastic_contact_info(index)
            surface = contact.contact_surface()
            force_on_m = contact.F_Ac_W().translational()
            for foot, geometries in enumerate(self._feet):
                if surface.id_M() in geometries:
                    forces[foot] += force_on_m
                elif surface.id_N() in geometries:
                    forces[foot] -= force_on_m
        return forces

    def history(self) -> History:
        """The frames as arrays, the torso's angles unwrapped."""
        stacked = {
            name: np.array([frame[name] for frame in self._frames]) for name in self._frames[0]
        }
        stacked["torso"][:, 3:] = np.unwrap(stacked["torso"][:, 3:], axis=0)
        return History(**stacked)
