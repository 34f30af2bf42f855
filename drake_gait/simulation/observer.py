"""Watches a walk while it is simulated: its time histories, and its measures by Drake itself.

Histories are taken at the control frames. Drake is asked for contacts and torques at every step,
which takes twice the time of the walk: the measures of a walk come from its log (`meter`), and
those of here test them.
"""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from pydrake.geometry import GeometryId
from pydrake.math import RollPitchYaw
from pydrake.multibody.plant import ContactResults
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import Context, EventStatus

from drake_gait.gait import FRAME_TIME, STANDING, FloatArray, Schedule
from drake_gait.simulation.contact import ground_of
from drake_gait.simulation.measures import swing_clearance
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.plant import Robot, sole_corners
from drake_gait.simulation.servo_joints import toe_positions
from drake_gait.walk import History, Measures

_SATURATED = 1.0 - 1e-6  # of the stall torque
_LIGHTEST = 1e-6  # A load whose centre is not looked for [N].


@dataclass(frozen=True, kw_only=True, eq=False)
class Touch:
    """One patch or point of a foot on the ground."""

    foot: int
    """0 right, 1 left."""
    body: RigidBody
    """The link of it."""
    force: FloatArray
    """Of the ground on it [N], shape (3,)."""
    place: FloatArray
    """Where, in the world [m], shape (3,)."""


class Observer:
    """Collects a History and Measures: `record` every frame, `monitor` every step."""

    def __init__(
        self,
        robot: Robot,
        commands: FloatArray,
        *,
        sent: FloatArray | None = None,
        mass: float = 1.0,
        delay: float = 0.0,
        schedule: Schedule = STANDING.schedule,
    ) -> None:
        """Watch a robot.

        Args:
            robot: What walks.
            commands: The gait's angles [rad], shape (n_frames, 10).
            sent: What its servos get [rad], shape (n_frames, m), where it differs.
            mass: Factor on the mass of every link.
            delay: Time by which the servos act on a command late [s].
            schedule: The gait's cycle and frames; the paper's by default.
        """
        self._schedule = schedule
        self._robot, self._commands, self._mass_factor = robot, commands, mass
        self._servo = robot.config.servo
        sent = robot.joints.sent(commands) if sent is None else sent
        plant, told = robot.plant, robot.model.robot
        # A copy to read from: the caches of the simulated context lag behind its state by up to a
        # step of CENIC's, and reading must not change what is simulated.
        self._context = default_context(robot.diagram)
        self._plant_context = plant.GetMyMutableContextFromRoot(self._context)
        self._gait_context = robot.gait.GetMyMutableContextFromRoot(self._context)
        robot.gait.set_commands(self._gait_context, sent, lead=-delay)
        self._torso = plant.GetBodyByName(told.torso)
        self._ankles = [plant.GetBodyByName(leg.ankle) for leg in told.legs]
        joints = [plant.GetJointByName(name) for name in robot.joints.names]
        self._joint_positions = [joint.position_start() for joint in joints]
        self._joint_velocities = [joint.velocity_start() for joint in joints]
        self._toe_positions = toe_positions(plant, told)
        self._absent = [np.nan if hinge is None else 0.0 for hinge in told.hinges]
        self._stall = robot.meter.stall
        self._back_emf = robot.meter.back_emf
        self._feet = [[plant.GetBodyByName(link) for link in leg.plates] for leg in told.legs]
        self._corners = [[sole_corners(robot, body) for body in foot] for foot in self._feet]
        self._geometries = {
            geometry: (foot, body)
            for foot, bodies in enumerate(self._feet)
            for body in bodies
            for geometry in plant.GetCollisionGeometriesForBody(body)
        }
        self._ground = ground_of(plant)
        self._frames: list[dict[str, FloatArray]] = []
        self._last: tuple[float, FloatArray, FloatArray] | None = None
        self._positive, self._absolute, self._saturated = 0.0, 0.0, 0.0
        self._peak_torque, self._peak_speed = 0.0, 0.0
        # Of torques, speeds and shares of the line: while servos drive, and while they brake.
        self._apart: FloatArray = np.zeros((2, 3))
        self._slip: FloatArray = np.zeros(2)
        self._rising: list[float] = []  # Vertical speed of the centre of mass at the frames [m/s].

    def monitor(self, context: Context) -> EventStatus:
        """Sum work, slip and peaks over one step of the integrator (trapezoidal rule)."""
        plant_context = self._copy(context)
        controller, speeds, torques = self._servos(plant_context)
        power = torques * speeds
        sliding = self._sliding_speeds(plant_context)
        time = context.get_time()
        if self._last is not None:
            before, last_power, last_sliding = self._last
            step = time - before
            self._positive += 0.5 * step * np.maximum([power, last_power], 0.0).sum()
            self._absolute += 0.5 * step * np.abs([power, last_power]).sum()
            self._slip += 0.5 * step * (sliding + last_sliding)
            self._saturated += step * float(np.mean(np.abs(controller) > _SATURATED * self._stall))
        self._last = time, power, sliding
        self._peak_torque = max(self._peak_torque, float(np.abs(torques).max()))
        self._peak_speed = max(self._peak_speed, float(np.abs(speeds).max()))
        sizes = np.abs([torques, speeds, controller / self._stall])
        for place, which in enumerate((power >= 0.0, power < 0.0)):
            peaks = sizes.max(axis=1, initial=0.0, where=which)
            self._apart[place] = np.maximum(self._apart[place], peaks)
        return EventStatus.DidNothing()

    def record(self, context: Context) -> None:
        """Take one frame from the diagram's context."""
        plant, plant_context = self._robot.plant, self._copy(context)
        joints = self._robot.joints
        positions = plant.GetPositions(plant_context)
        _, speeds, torques = self._servos(plant_context)
        v_WC = plant.CalcCenterOfMassTranslationalVelocityInWorld(plant_context)
        self._rising.append(float(v_WC[2]))
        X_WT = plant.EvalBodyPoseInWorld(plant_context, self._torso)
        poses = (plant.EvalBodyPoseInWorld(plant_context, ankle) for ankle in self._ankles)
        self._frames.append(
            {
                "time": np.array(context.get_time()),
                "positions": positions,
                "com": plant.CalcCenterOfMassPositionInWorld(plant_context),
                "torso": np.concatenate(
                    [X_WT.translation(), RollPitchYaw(X_WT.rotation()).vector()]
                ),
                "ankles": np.array([pose.translation() for pose in poses]),
                "commands": self._commands[len(self._frames)],
                "angles": joints.by_role(positions[self._joint_positions], angles=True),
                "speeds": joints.by_role(speeds),
                "torques": joints.by_role(torques),
                "toes": self._toe_angles(positions),
                "ground_reaction": self._ground_reaction(plant_context),
                "sole_height": self._sole_heights(plant_context),
            }
        )

    def history(self) -> History:
        """The frames as arrays, the torso's angles unwrapped."""
        stacked = {
            name: np.array([frame[name] for frame in self._frames]) for name in self._frames[0]
        }
        stacked["torso"][:, 3:] = np.unwrap(stacked["torso"][:, 3:], axis=0)
        return History(**stacked, schedule=self._schedule)

    def measures(self, history: History, forward: float) -> Measures:
        """Return the measures of a walk with this history that went `forward` [m]."""
        plant = self._robot.plant
        gravity = np.abs(plant.gravity_field().gravity_vector()[2])
        mass = self._mass_factor * plant.CalcTotalMass(plant.CreateDefaultContext())
        weight = mass * gravity
        loaded = history.ground_reaction[:, :, 2] > self._robot.meter.load
        begin, end = self._schedule.second_cycle
        cycle = (history.time >= begin) & (history.time < end)
        duty = loaded[cycle].mean(axis=0) if cycle.any() else np.full(2, np.nan)
        roll, pitch = history.torso[:, 3], history.torso[:, 4]
        tilt = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0))
        return Measures(
            energy=float(self._absolute),
            positive_energy=float(self._positive),
            cost_of_transport=float(self._positive / (weight * forward)) if forward > 0 else np.inf,
            peak_torque=self._peak_torque,
            peak_speed=self._peak_speed,
            driving_torque=float(self._apart[0, 0]),
            braking_torque=float(self._apart[1, 0]),
            driving_speed=float(self._apart[0, 1]),
            braking_speed=float(self._apart[1, 1]),
            line_share=float(self._apart[0, 2]),
            saturated_fraction=float(self._saturated / max(history.time[-1], FRAME_TIME)),
            slip=(float(self._slip[0]), float(self._slip[1])),
            clearance=(
                swing_clearance(history.sole_height[:, 0], self._schedule),
                swing_clearance(history.sole_height[:, 1], self._schedule),
            ),
            duty_factor=(float(duty[0]), float(duty[1])),
            # By momentum: forces read from a state that ends a step are not those of the step.
            peak_ground_reaction=1.0
            + float(np.diff(self._rising).max(initial=0.0)) / (gravity * FRAME_TIME),
            toe_range=tuple(np.nan_to_num(history.toes.max(axis=0)).tolist()),
            torso_tilt=float(tilt.max()),
        )

    def _copy(self, context: Context) -> Context:
        """The plant's context to read from, at the time and state of the simulated one."""
        plant = self._robot.plant
        state = plant.GetPositionsAndVelocities(plant.GetMyContextFromRoot(context))
        self._context.SetTime(context.get_time())
        plant.SetPositionsAndVelocities(self._plant_context, state)
        self._robot.gait.set_angles(self._gait_context, state[self._joint_positions])
        return self._plant_context

    def _toe_angles(self, positions: FloatArray) -> FloatArray:
        """Angles of the toes [rad], shape (4,); 0 of rigid ones, NaN of those that are none."""
        angles = np.array(self._absent)
        for column, index in self._toe_positions.items():
            angles[column] = positions[index]
        return angles

    def _servos(self, plant_context: Context) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Controllers' torques [N·m], speeds [rad/s] and torques on the joints, (m,) each."""
        plant = self._robot.plant
        speeds = plant.GetVelocities(plant_context)[self._joint_velocities]
        port = plant.get_net_actuation_output_port()
        controller = cast(FloatArray, port.Eval(plant_context))
        motor = self._servo.motor_torque(controller, speeds, self._back_emf)
        return controller, speeds, self._servo.joint_torque(motor, speeds)

    def _contacts(self, plant_context: Context) -> list[Touch]:
        """Return the touches of feet and ground: patches of surfaces, and points."""
        port = self._robot.plant.get_contact_results_output_port()
        results = cast(ContactResults, port.Eval(plant_context))
        found: list[tuple[tuple[GeometryId, GeometryId], FloatArray, FloatArray]] = []
        for index in range(results.num_hydroelastic_contacts()):
            patch = results.hydroelastic_contact_info(index)
            surface, F_Ac_W = patch.contact_surface(), patch.F_Ac_W()
            force, torque = F_Ac_W.translational(), F_Ac_W.rotational()
            ids = surface.id_M(), surface.id_N()
            # The centre of its load, about which it has no horizontal moment.
            arm: FloatArray = np.array([-torque[1], torque[0], 0.0])
            arm /= force[2] if abs(force[2]) > _LIGHTEST else np.inf
            found.append((ids, force, cast(FloatArray, surface.centroid()) + arm))
        for index in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(index)
            ids = pair.point_pair().id_A, pair.point_pair().id_B
            found.append((ids, np.negative(pair.contact_force()), pair.contact_point()))
        return [
            Touch(foot=foot, body=body, force=sign * force, place=place)
            for (first, second), force, place in found
            for one, other, sign in ((first, second, 1.0), (second, first, -1.0))
            if other == self._ground and one in self._geometries
            for foot, body in (self._geometries[one],)
        ]

    def _ground_reaction(self, plant_context: Context) -> FloatArray:
        """Force on each foot [N], shape (2, 3)."""
        forces: FloatArray = np.zeros((2, 3))
        for touch in self._contacts(plant_context):
            forces[touch.foot] += touch.force
        return forces

    def _sliding_speeds(self, plant_context: Context) -> FloatArray:
        """Speed over the ground of the most loaded plate of each foot [m/s], shape (2,).

        It is that of the middle of what touches, by load.
        """
        plant = self._robot.plant
        plates: dict[int, list[Touch]] = {}
        for touch in self._contacts(plant_context):
            plates.setdefault(int(touch.body.index()), []).append(touch)
        speeds, loads = np.zeros(2), np.full(2, self._robot.meter.load)
        for touches in plates.values():
            foot, body = touches[0].foot, touches[0].body
            weights = [abs(touch.force[2]) for touch in touches]
            if sum(weights) <= loads[foot]:
                continue
            p_WC = np.average([touch.place for touch in touches], axis=0, weights=weights)
            velocity = plant.EvalBodySpatialVelocityInWorld(plant_context, body)
            p_WB: FloatArray = plant.EvalBodyPoseInWorld(plant_context, body).translation()
            v_WC = velocity.Shift(cast(Any, p_WC - p_WB)).translational()
            speeds[foot], loads[foot] = np.hypot(v_WC[0], v_WC[1]), sum(weights)
        return speeds

    def _sole_heights(self, plant_context: Context) -> FloatArray:
        """Height of the lowest corner of each foot [m], shape (2,)."""
        plant = self._robot.plant
        heights = [
            min(
                float((plant.EvalBodyPoseInWorld(plant_context, body) @ corners)[2].min())
                for body, corners in zip(bodies, foot_corners, strict=True)
            )
            for bodies, foot_corners in zip(self._feet, self._corners, strict=True)
        ]
        return np.array(heights)
