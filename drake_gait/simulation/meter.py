"""Measures a walk from the states that Drake has logged at the ends of its steps.

No Python runs while the robot walks: a sink of Drake's logs, and arrays are computed afterwards.
"""

from typing import cast

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant

from drake_gait.gait import FRAME_TIME, FloatArray
from drake_gait.robot.description import read_model
from drake_gait.simulation.collision import box_corners
from drake_gait.simulation.command_source import commands_at
from drake_gait.simulation.kinematics import Kinematics, Motion
from drake_gait.simulation.measures import Record
from drake_gait.simulation.plant_config import PlantConfig
from drake_gait.simulation.servo_joints import actuators, servo_joints, toe_positions
from drake_gait.simulation.tread import Tread, treads

_PRECISION = np.float32
"""Half the bytes take half the time, and depths in the ground stay good to 0.1 µm."""


_LARGE_BLOCK = 1 << 20
_LOADED = 0.03
"""Part of the weight from which a foot counts as carrying load, where the robot's file has none."""


class Meter:
    """Meter of a robot, with all that stays the same from walk to walk."""

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        config: PlantConfig,
    ) -> None:
        """Take the constants of a finalized plant with its shapes, made as `config` says."""
        # glibc's malloc returns memory to the system at every instant, until a block this large was
        # freed: half of the time of `record` is then spent on getting it back.
        np.empty(_LARGE_BLOCK)
        self._robot = robot = read_model(config.model).robot
        self._kinematics = Kinematics(plant, robot.torso)
        self._servo, self._joints = config.servo, servo_joints(plant, robot)
        self.stall: FloatArray = np.array(
            [actuator.effort_limit() for actuator in actuators(plant)]
        )
        """Largest torque of each controller [N·m], shape (m,)."""
        # Stall torque and no-load speed both scale with the voltage: their ratio stays.
        self.back_emf: FloatArray = self._joints.back_emf(self._servo, self.stall, config.supply)
        """Torque that each motor loses to its speed [N·m·s/rad], shape (m,)."""
        joints = [actuator.joint() for actuator in actuators(plant)]
        self._angles = [joint.position_start() for joint in joints]
        self._speeds = [plant.num_positions() + joint.velocity_start() for joint in joints]
        self._toes = toe_positions(plant, robot)
        weight = self._kinematics.mass * float(abs(plant.gravity_field().gravity_vector()[2]))
        self.load = _LOADED * weight if robot.load is None else robot.load
        """Vertical force from which a foot counts as carrying load [N]."""
        self._plates: list[tuple[str, Tread, FloatArray]] = []
        for name, tread in treads(plant, scene_graph, config.sole, robot).items():
            # Rigid toes are part of the heel's link.
            link, X_LB = self._kinematics.fixed(name)
            corners = box_corners(plant, scene_graph, plant.GetBodyByName(name)).values()
            moved = (X_LB @ np.hstack(list(corners))).T
            self._plates.append((link, tread.within(X_LB, _PRECISION), moved))
        self._gravity = float(np.abs(plant.gravity_field().gravity_vector()[2]))

    def record(
        self,
        time: FloatArray,
        states: FloatArray,
        commands: FloatArray,
        mass: float = 1.0,
        *,
        delay: float = 0.0,
    ) -> Record:
        """Return what is known of a walk.

        Args:
            time: The ends of its steps [s], from 0 on, shape (n,).
            states: Positions, then velocities, of the plant at them, shape (n_q + n_v, n).
            commands: What the servos were sent [rad], shape (n_frames, m), one row a frame.
            mass: Factor on the mass of every link.
            delay: Time by which the servos act on a command late [s].
        """
        frames, servo = _frames(time), self._servo
        speeds = states[self._speeds]
        error = servo.engaged(commands_at(commands, time - delay).T - states[self._angles])
        controllers = self._joints.controller_torque(servo, error, speeds, self.stall)
        motors = servo.motor_torque(controllers, speeds, self.back_emf[:, None])
        motions = self._kinematics.motions(states.astype(_PRECISION))
        pressed = [tread.load(motions[link]) for link, tread, _ in self._plates]
        at_frames = {link: motion.at(frames) for link, motion in motions.items()}
        heights = [
            at_frames[link].heights(corners).min(axis=0) for link, _, corners in self._plates
        ]
        return Record(
            time=time,
            frames=frames,
            speeds=speeds,
            controllers=controllers,
            torques=servo.joint_torque(motors, speeds),
            stall=self.stall,
            loads=np.array([load for load, _ in pressed]),
            sliding=np.array([sliding for _, sliding in pressed]),
            toes=self._toe_angles(states, frames),
            sole_height=np.array([np.min(foot, axis=0) for foot in np.split(np.array(heights), 2)]),
            rising=self._kinematics.centre_velocity(at_frames)[2],
            upright=at_frames[self._robot.torso].axes[2, 2],
            mass=mass * self._kinematics.mass,
            gravity=self._gravity,
            load=self.load,
        )

    def _toe_angles(self, states: FloatArray, frames: np.ndarray) -> FloatArray:
        """Return the angles of the toes at frames [rad], shape (4, m): 0 of those that are none."""
        angles: FloatArray = np.zeros((len(self._robot.hinges), len(frames)))
        for row, place in self._toes.items():
            angles[row] = states[place, frames]
        return angles

    def motions(self, states: FloatArray) -> dict[str, tuple[Motion, Tread]]:
        """Return the motion of each link of the feet, by its name, and what touches under it.

        Args:
            states: Positions, then velocities, of the plant, shape (n_q + n_v, n).
        """
        found = self._kinematics.motions(states.astype(_PRECISION))
        return {
            name: (found[link], tread)
            for name, (link, tread, _) in zip(self._robot.plates, self._plates, strict=True)
        }


def _frames(time: FloatArray) -> np.ndarray:
    """Return which instants are frames: steps end at each of them."""
    count = int(time[-1] / FRAME_TIME + 0.5) + 1
    return cast(np.ndarray, np.searchsorted(time, np.arange(count) * FRAME_TIME - 1e-9))
