"""Poses and velocities of a robot's links at many instants at once.

Drake evaluates one instant at a time, which from Python costs more than the walk for all of its
steps. These are the same formulas over arrays, with the constants of the plant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, RevoluteJoint, RigidBody, WeldJoint

from drake_gait.gait import FloatArray

Floats = np.ndarray[Any, np.dtype[np.floating]]
"""Numbers as precise as the states that are given: half the bytes take half the time."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """A frame B that moves in the world W, at n instants."""

    axes: Floats
    """R_WB by columns, shape (3, 3, n): `axes[k]` is B's axis k in the world."""
    place: Floats
    """p_WB [m], shape (3, n)."""
    turning: Floats
    """w_WB [rad/s], shape (3, n)."""
    velocity: Floats
    """v_WB [m/s], shape (3, n)."""

    def at(self, instants: np.ndarray) -> "Motion":
        """Return the motion at some of the instants, given by their numbers or a mask."""
        return Motion(
            axes=self.axes[:, :, instants],
            place=self.place[:, instants],
            turning=self.turning[:, instants],
            velocity=self.velocity[:, instants],
        )

    def direction(self, fixed: Floats) -> Floats:
        """Return a direction that is fixed in B, shape (3,), in the world, shape (3, n)."""
        (found,) = _combined(fixed[None], self.axes)
        return cast(Floats, found)

    def heights(self, points: Floats) -> Floats:
        """Return the height of points p_BP [m], shape (k, 3): shape (k, n)."""
        heights: Floats = _like(points, self.place) @ self.axes[:, 2]
        heights += self.place[2]
        return heights

    def rising(self, points: Floats, upward: FloatArray | None = None) -> Floats:
        """Return the speed of points p_BP [m], shape (k, 3), along a direction that is fixed in B.

        Args:
            points: The points.
            upward: The direction in B, shape (3,); by default up in the world.

        Returns:
            Speeds [m/s], shape (k, n).
        """
        if upward is None:
            x, y, _ = self.turning
            along, lever = self.velocity[2], x * self.axes[:, 1] - y * self.axes[:, 0]
        else:
            n_W = self.direction(upward)
            along = _dot(n_W, self.velocity)
            across = _cross(n_W, self.turning)
            lever = np.stack([_dot(axis, across) for axis in self.axes])  # (w x r) n = r (n x w)
        rising: Floats = _like(points, self.place) @ lever
        rising += along
        return rising

    def velocity_at(self, point: Floats) -> Floats:
        """Return v_WP [m/s], shape (3, n), of a point p_BP [m], shape (3, n) or (3, 1)."""
        x, y, z = self.axes
        offset = x * point[0] + y * point[1] + z * point[2]
        return self.velocity + _cross(self.turning, offset)


class Kinematics:
    """A robot's links, of which each turns about a hinge of another, from the torso on.

    Links that are welded together are one.
    """

    def __init__(self, plant: MultibodyPlant, torso: str) -> None:
        """Take the constants of a finalized plant with a robot on its feet, whose torso floats."""
        self._plant, self._torso = plant, torso
        context = plant.CreateDefaultContext()
        base = plant.GetBodyByName(torso)
        instance = base.model_instance()
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(instance)]
        above = {joint.child_body().name(): joint for joint in joints}

        hinged = {name: joint for name, joint in above.items() if not isinstance(joint, WeldJoint)}
        hinged.pop(base.name(), None)  # Drake's floating base is a joint too.

        def carrier(body: RigidBody) -> RigidBody:
            """The link that a body is welded to, or itself."""
            joint = above.get(body.name())
            welded = isinstance(joint, WeldJoint)
            return carrier(joint.parent_body()) if joint is not None and welded else body

        def pose(body: RigidBody) -> RigidTransform:
            return plant.EvalBodyPoseInWorld(context, body)

        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
        self._first = base.floating_positions_start(), base.floating_velocities_start_in_v()
        turns = all(isinstance(joint, RevoluteJoint) for joint in hinged.values())
        # Where links turn only, the frame of each is that of its hinge, whose x axis is the axis.
        frames = {name: _at_hinge(joint) for name, joint in hinged.items()} if turns else {}
        self._fixed = {
            body.name(): (
                carrier(body).name(),
                frames.get(carrier(body).name(), RigidTransform()).inverse()
                @ pose(carrier(body)).inverse()
                @ pose(body),
            )
            for body in bodies
        }
        self._hinges = _ordered(
            [_hinge(name, joint, self._fixed) for name, joint in hinged.items()] if turns else [],
            torso,
        )
        self._turns = turns
        moments: dict[str, tuple[float, FloatArray]] = {}
        for body in bodies:
            link, X_LB = self._fixed[body.name()]
            mass = body.get_mass(context)
            p_LC = X_LB @ body.CalcCenterOfMassInBodyFrame(context)
            before, moment = moments.get(link, (0.0, np.zeros(3)))
            moments[link] = before + mass, moment + mass * p_LC
        self._masses = {
            link: (mass, (moment / mass)[:, None])
            for link, (mass, moment) in moments.items()
            if mass > 0.0
        }

    @property
    def mass(self) -> float:
        """The mass of the robot [kg]."""
        return sum(mass for mass, _ in self._masses.values())

    def motions(self, states: Floats) -> dict[str, Motion]:
        """Return the motion of every link that turns, and of the torso, by its name.

        Args:
            states: Positions, then velocities, of the plant, shape (n_q + n_v, n).
        """
        if not self._turns:
            return self._motions_by_plant(states)
        speeds = states[self._plant.num_positions() :]
        motions = {self._torso: self._base(states, speeds)}
        for hinge in self._hinges:
            motions[hinge.link] = hinge.motion(
                motions[hinge.parent], states[hinge.position], speeds[hinge.velocity]
            )
        return motions

    def fixed(self, body: str) -> tuple[str, RigidTransform]:
        """Return the name of the link L that a body B is part of, and X_LB.

        The frame of a link is one that `motions` knows; it need not be Drake's.
        """
        return self._fixed[body]

    def centre_velocity(self, motions: dict[str, Motion]) -> Floats:
        """Return the velocity of the centre of mass [m/s], shape (3, n)."""
        momentum = sum(
            mass * motions[link].velocity_at(p_LC) for link, (mass, p_LC) in self._masses.items()
        )
        return cast(Floats, momentum / self.mass)

    def _base(self, states: Floats, speeds: Floats) -> Motion:
        position, velocity = self._first
        pose, motion = states[position : position + 7], speeds[velocity : velocity + 6]
        w, x, y, z = pose[:4] / np.sqrt((pose[:4] ** 2).sum(axis=0))
        axes: Floats = np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)],
                [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)],
                [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )
        return Motion(axes=axes, place=pose[4:], turning=motion[:3], velocity=motion[3:])

    def _motions_by_plant(self, states: Floats) -> dict[str, Motion]:
        """Ask Drake, instant by instant: robots with other joints than hinges are rare."""
        plant, context = self._plant, self._plant.CreateDefaultContext()
        links = {link: plant.GetBodyByName(link) for link, _ in self._fixed.values()}
        found: dict[str, list[FloatArray]] = {link: [] for link in links}
        for state in states.T:
            plant.SetPositionsAndVelocities(context, state)
            for link, body in links.items():
                X_WB = plant.EvalBodyPoseInWorld(context, body)
                V_WB = plant.EvalBodySpatialVelocityInWorld(context, body)
                columns = X_WB.rotation().matrix().T.ravel()
                found[link].append(
                    np.concatenate(
                        [columns, X_WB.translation(), V_WB.rotational(), V_WB.translational()]
                    )
                )
        motions = {}
        for link, rows in found.items():
            numbers = np.array(rows).T
            motions[link] = Motion(
                axes=numbers[:9].reshape(3, 3, -1),
                place=numbers[9:12],
                turning=numbers[12:15],
                velocity=numbers[15:],
            )
        return motions


@dataclass(frozen=True, kw_only=True, eq=False)
class _Hinge:
    """A link L that turns about the x axis of its own frame, which is at a hinge on a link P."""

    parent: str
    link: str
    position: int
    velocity: int
    R_PL: FloatArray
    """How L stands at the angle 0, shape (3, 3)."""
    place: FloatArray
    """Where the hinge is: p_PL [m], shape (3,)."""

    def motion(self, parent: Motion, angle: Floats, speed: Floats) -> Motion:
        """Return the motion of L from that of P, angles [rad] and speeds [rad/s], shape (n,)."""
        x, y, z, arm = _combined(np.vstack([self.R_PL.T, self.place]), parent.axes)
        cos, sin = np.cos(angle), np.sin(angle)
        return Motion(
            axes=np.stack([x, cos * y + sin * z, cos * z - sin * y]),
            place=parent.place + arm,
            turning=parent.turning + x * speed,
            velocity=parent.velocity + _cross(parent.turning, arm),
        )


def _at_hinge(joint: Joint) -> RigidTransform:
    """Return where a revolute joint is in its child, turned so that its axis is x."""
    X_LJ: RigidTransform = joint.frame_on_child().GetFixedPoseInBodyFrame() @ _along_x(joint)
    return X_LJ


def _along_x(joint: Joint) -> RigidTransform:
    """Return a rotation of the frame of a revolute joint whose x axis is the joint's axis."""
    axis = cast(RevoluteJoint, joint).revolute_axis()
    return RigidTransform(RotationMatrix.MakeFromOneVector(axis, 0))


def _hinge(link: str, joint: Joint, fixed: dict[str, tuple[str, RigidTransform]]) -> _Hinge:
    """Return a revolute joint as a hinge between links that turn."""
    parent, X_PB = fixed[joint.parent_body().name()]
    X_PL = X_PB @ joint.frame_on_parent().GetFixedPoseInBodyFrame() @ _along_x(joint)
    return _Hinge(
        parent=parent,
        link=link,
        position=joint.position_start(),
        velocity=joint.velocity_start(),
        R_PL=X_PL.rotation().matrix(),
        place=X_PL.translation(),
    )


def _ordered(hinges: Sequence[_Hinge], torso: str) -> list[_Hinge]:
    """Return the hinges so that each comes after the one that carries it."""
    known, found, waiting = {torso}, list[_Hinge](), list(hinges)
    while waiting:
        ready = [hinge for hinge in waiting if hinge.parent in known]
        found += ready
        known |= {hinge.link for hinge in ready}
        waiting = [hinge for hinge in waiting if hinge.link not in known]
    return found


def _like(constants: Floats, numbers: Floats) -> Floats:
    """Return constants as precise as numbers."""
    return constants.astype(numbers.dtype)


def _combined(constants: Floats, axes: Floats) -> Floats:
    """Return vectors that are fixed in a frame, shape (k, 3), in the world, shape (k, 3, n)."""
    flat: Floats = _like(constants, axes) @ axes.reshape(3, -1)
    return flat.reshape(-1, *axes.shape[1:])


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the inner product of vectors, shape (3, n) each: shape (n,)."""
    product: Floats = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross product of vectors, shape (3, n) each: numpy's takes five times as long."""
    product: Floats = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=a.dtype)
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]
    return product
