"""Draw where the ground carries a foot in five phases of a step: `python tools/draw_patches.py`.

One picture a sole, docs/images/patch-SOLE.png, of the right foot in its stance of the second
cycle. Faces of a surface have the colour of their elastic pressure, points that of their force.
A gait is the middle of a study's box, or a walk that a study has found (--run, --walk).
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import LogNorm
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import ContactResults

from drake_gait.gait import CYCLE_TIME, FloatArray
from drake_gait.problem import Candidate
from drake_gait.simulation.contact import ground_of, plates
from drake_gait.simulation.messages import default_context
from drake_gait.simulation.plant import Robot
from drake_gait.simulation.simulate import prepare, start
from drake_gait.sole import Sole
from drake_gait.study.reading import default_study, read_study
from drake_gait.study.settings import study_settings
from drake_gait.study.store import Study
from drake_gait.visualization.palette import INK
from drake_gait.visualization.style import PAGE, new_figure, save_figure, style
from drake_gait.walk import Fidelity, Integrator, WalkSettings

PHASES = ("heel strike", "flat", "mid-stance", "heel-off", "toe-off")
LOOK = 0.004
"""Time between two looks at a walk [s]."""
STEP = Integrator(step=0.001)
LOADED = 0.1
"""Part of the weight from which a foot is in stance: less is a scuffing toe."""
ALMOST = 0.7
"""Part of the largest extent from which a foot is flat: its toes' tips need not touch."""
PRESSURES = (1.0, 100.0)
"""Ends of the scale of colours [kPa]."""
FORCES = (0.1, 10.0)
"""Ends of the scale of points [N]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Print:
    """What is under the right foot at one instant, seen from above [mm], x forward, y left."""

    time: float
    """Since the walk began [s]."""
    load: float
    """Vertical force of the ground on the foot [N]."""
    ahead: float
    """Centre of mass ahead of the middle of the heel plate [mm]."""
    rear: float
    """Height of the lower rear corner of the heel plate [mm]."""
    extent: float
    """Size of the smallest box around all that touches [mm²]."""
    outlines: list[FloatArray]
    """Corners of each plate, shape (4, 2)."""
    faces: list[FloatArray]
    """Corners of each face, shape (n, 2)."""
    pressures: list[float]
    """Of each face [kPa]."""
    points: list[FloatArray]
    """Places, shape (2,)."""
    forces: list[float]
    """Of each point [N]."""


def prints(candidate: Candidate, settings: WalkSettings) -> Iterator[Print]:
    """Walk a candidate and look at its right foot until the end of the third cycle."""
    robot, context = prepare(
        candidate.gait.commands_from(settings.start), candidate.foot, settings, logged=False
    )
    own, copied = robot.plant.GetMyContextFromRoot(context), default_context(robot.diagram)
    copy = robot.plant.GetMyMutableContextFromRoot(copied)
    simulator = start(robot.diagram, context, settings.stepping)
    for index in range(int(3.0 * CYCLE_TIME / LOOK)):
        simulator.AdvanceTo((index + 1) * LOOK)
        # A copy: the simulated context's caches lag behind its state.
        robot.plant.SetPositionsAndVelocities(copy, robot.plant.GetPositionsAndVelocities(own))
        yield look(robot, copy, context.get_time())


def look(robot: Robot, plant_context: Any, time: float) -> Print:
    """Return what is under the right foot in a context of the plant."""
    plant = robot.plant
    under = [
        plate for plate in plates(plant, robot.scene_graph, robot.model.robot) if not plate.is_left
    ]
    heel = next(plate for plate in under if not plate.is_toe)
    X_WH = plant.EvalBodyPoseInWorld(plant_context, plant.GetBodyByName(heel.link)) @ heel.X_LP
    yaw = RollPitchYaw(X_WH.rotation()).yaw_angle()
    middle = X_WH.translation() * (1.0, 1.0, 0.0)
    X_FW = RigidTransform(RollPitchYaw(0.0, 0.0, yaw), middle).inverse()
    outlines, rear = [], 0.0
    for plate in under:
        x, y = plate.length / 2.0, plate.width / 2.0
        corners = np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], dtype=float).T
        X_WL = plant.EvalBodyPoseInWorld(plant_context, plant.GetBodyByName(plate.link))
        p_WC = X_WL @ plate.X_LP @ corners
        outlines.append(1e3 * (X_FW @ p_WC)[:2].T)
        if plate is heel:
            rear = 1e3 * float(min(p_WC[2, 0], p_WC[2, 3]))
    found = touching(robot, plant_context, X_FW)
    places = np.vstack([*found.faces, *[one[None] for one in found.points], np.zeros((1, 2))])
    com = X_FW @ plant.CalcCenterOfMassPositionInWorld(plant_context)
    touched = places[:-1]
    return Print(
        time=time,
        load=found.load,
        ahead=1e3 * float(com[0]),
        rear=rear,
        extent=float(np.prod(np.ptp(touched, axis=0))) if len(touched) else 0.0,
        outlines=outlines,
        faces=found.faces,
        pressures=found.pressures,
        points=found.points,
        forces=found.forces,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Touching:
    """Faces, points and load of `touching`, as in a Print."""

    load: float
    faces: list[FloatArray]
    pressures: list[float]
    points: list[FloatArray]
    forces: list[float]


def touching(robot: Robot, plant_context: Any, X_FW: RigidTransform) -> Touching:
    """Return what touches the ground under the right foot, in frame F of the foot."""
    plant = robot.plant
    ground = ground_of(plant)
    right = {
        geometry
        for plate in plates(plant, robot.scene_graph, robot.model.robot)
        if not plate.is_left
        for geometry in plant.GetCollisionGeometriesForBody(plant.GetBodyByName(plate.link))
    }
    results = cast(ContactResults, plant.get_contact_results_output_port().Eval(plant_context))
    load = 0.0
    faces: list[FloatArray] = []
    pressures: list[float] = []
    points: list[FloatArray] = []
    forces: list[float] = []
    for index in range(results.num_hydroelastic_contacts()):
        patch = results.hydroelastic_contact_info(index)
        surface = patch.contact_surface()
        ids = {surface.id_M(), surface.id_N()}
        if ground not in ids or not ids & right:
            continue
        load += abs(float(patch.F_Ac_W().translational()[2]))
        mesh, field = surface.poly_mesh_W(), surface.poly_e_MN()
        for face, corners in enumerate(polygons(mesh)):
            faces.append(1e3 * (X_FW @ corners.T)[:2].T)
            middle = mesh.element_centroid(face)
            pressures.append(1e-3 * float(field.EvaluateCartesian(face, middle)))
    for index in range(results.num_point_pair_contacts()):
        pair = results.point_pair_contact_info(index)
        if {pair.point_pair().id_A, pair.point_pair().id_B} & right:
            force = abs(float(pair.contact_force()[2]))
            load += force
            points.append(1e3 * np.asarray(X_FW @ pair.contact_point())[:2])
            forces.append(force)
    return Touching(load=load, faces=faces, pressures=pressures, points=points, forces=forces)


def polygons(mesh: Any) -> Iterator[FloatArray]:
    """Corners of each face of a mesh [m], shape (n, 3)."""
    data, begin = list(mesh.face_data()), 0
    while begin < len(data):
        count = data[begin]
        yield np.array([mesh.vertex(v) for v in data[begin + 1 : begin + 1 + count]])
        begin += 1 + count


def phases(seen: Sequence[Print], weight: float) -> list[Print]:
    """The five phases of the right foot's first whole stance after the first cycle.

    Heel strike and toe-off are its first and last instant with load. Flat is the first at which
    what touches reaches almost as far apart as it ever does before mid-stance. At mid-stance the
    centre of mass comes over the heel plate's middle, at heel-off the rear edge leaves the ground.
    """
    loaded = np.array([one.load > LOADED * weight for one in seen], dtype=int)
    edges = np.diff(loaded)
    begins = [int(k) + 1 for k in np.flatnonzero(edges > 0) if seen[k].time > CYCLE_TIME]
    ends = [int(k) for k in np.flatnonzero(edges < 0) if begins and k >= begins[0]]
    if not ends:
        raise SystemExit(
            "error: the right foot has no whole stance in the second and third cycle; "
            "name a gait that walks (--run, --walk)"
        )
    begin, end = begins[0], ends[0]
    stance = list(seen[begin : end + 1])
    middle = next((k for k, one in enumerate(stance) if one.ahead > 0.0), len(stance) // 2)
    extents = np.array([one.extent for one in stance[: max(middle, 1)]])
    flat = int(np.argmax(extents >= ALMOST * extents.max()))
    off = next((k for k in range(middle, len(stance)) if stance[k].rear > 0.0), len(stance) - 1)
    return [stance[k] for k in (0, flat, middle, off, -1)]


def draw(chosen: Sequence[Print], sole: Sole, path: Path) -> None:
    """Draw five prints side by side and write them."""
    with style():
        figure = new_figure(PAGE, 2.7)
        axes = figure.subplots(1, len(chosen), sharex=True, sharey=True)
        surface = bool(chosen[2].faces)
        norm = LogNorm(*(PRESSURES if surface else FORCES), clip=True)
        drawn: Any = None
        for phase, one, axis in zip(PHASES, chosen, axes, strict=True):
            for outline in one.outlines:
                ring = np.vstack([outline, outline[:1]])
                axis.plot(-ring[:, 1], ring[:, 0], color=INK, linewidth=0.7)
            if surface:
                drawn = PolyCollection(
                    [np.column_stack([-face[:, 1], face[:, 0]]) for face in one.faces],
                    array=np.array(one.pressures),
                    norm=norm,
                    cmap="viridis_r",
                    edgecolors=INK,
                    linewidths=0.2,
                )
                axis.add_collection(drawn)
            else:
                places = np.array(one.points).reshape(-1, 2)
                drawn = axis.scatter(
                    -places[:, 1],
                    places[:, 0],
                    c=one.forces,
                    norm=norm,
                    cmap="viridis_r",
                    s=30.0,
                    edgecolors=INK,
                    linewidths=0.3,
                    zorder=3,
                )
            axis.set_title(f"{phase}\n{one.time:.2f} s, {one.load:.1f} N")
            axis.set_aspect("equal")
            axis.set_xlabel("right [mm]")
        axes[0].set_ylabel("forward [mm]")
        label = "elastic pressure [kPa]" if surface else "force of a point [N]"
        bar = figure.colorbar(drawn, ax=list(axes), label=label, aspect=30.0, pad=0.01)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.ax.yaxis.set_minor_formatter("")
        save_figure(figure, path)


def candidate_of(study: Path, run: Path | None, walk: int | None) -> tuple[WalkSettings, Candidate]:
    """The settings of a walk, and what walks."""
    if run is None:
        settings = read_study(study)
        return settings.walk, settings.space.decode(np.zeros(settings.space.dimension))
    with Study.open(run) as opened:
        described = study_settings(opened.description()["settings"])
        return described.walk, opened.walks()[walk or 0].candidate


def main() -> None:
    """Walk, draw and print what each picture shows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("study", nargs="?", type=Path, default=default_study())
    parser.add_argument("--run", type=Path, help="a study that has run, instead of the box")
    parser.add_argument("--walk", type=int, help="number of a walk of --run")
    parser.add_argument("--soles", type=Sole, nargs="+", choices=list(Sole), default=list(Sole))
    parser.add_argument("--output", type=Path, default=Path("docs/images"))
    options = parser.parse_args()
    base, candidate = candidate_of(options.study, options.run, options.walk)
    for sole in options.soles:
        settings = WalkSettings(
            model=base.model,
            start=base.start,
            servo=base.servo,
            sole=sole,
            fidelity=Fidelity.REFERENCE,
            integrator=STEP,
        )
        robot, _ = prepare(candidate.gait.commands_from(base.start), candidate.foot, settings)
        weight = 9.81 * robot.plant.CalcTotalMass(robot.plant.CreateDefaultContext())
        chosen = phases(list(prints(candidate, settings)), weight)
        path = options.output / f"patch-{sole}.png"
        draw(chosen, sole, path)
        rows = [
            f"{phase} {one.time:.3f} s {one.load:.1f} N"
            for phase, one in zip(PHASES, chosen, strict=True)
        ]
        print(f"{path}: {'; '.join(rows)}", flush=True)


if __name__ == "__main__":
    main()
