"""The files of a study's folder beside study.db: its report and all that is in it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drake_gait.files.destination import check, make_folder, write
from drake_gait.files.strict_json import plain, to_json
from drake_gait.gait import FRAME_TIME, FloatArray, Start
from drake_gait.problem import Trial, evaluated
from drake_gait.report.page import FIGURES, PORTRAIT, Run, write_study_page
from drake_gait.report.result import in_words, summary
from drake_gait.report.study_result import RESULT, StudyResult, quantities_of
from drake_gait.search.confirmation import walked_as
from drake_gait.search.proposer import training_data
from drake_gait.simulation.plant import stall_torques
from drake_gait.simulation.simulate import simulate
from drake_gait.study.finalists import measured, winner
from drake_gait.study.ranking import best_walk, search_walks
from drake_gait.study.records import StudyWalk
from drake_gait.study.robot import settings_with_robot
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import PROPOSER, Study
from drake_gait.study.toml import write_study_toml
from drake_gait.surrogates import ensemble as surrogate
from drake_gait.surrogates.baselines import Comparison, compare
from drake_gait.surrogates.ensemble import Surrogate
from drake_gait.surrogates.sensitivity import sensitivity
from drake_gait.visualization import study as study_figures
from drake_gait.visualization import walk as walk_figures
from drake_gait.visualization.portraits import chronophotograph, pictures
from drake_gait.visualization.recording import record
from drake_gait.visualization.style import save_picture
from drake_gait.walk import History, Measures, Walk, WalkSettings

_ROOM = 0.17  # from one exposure of a portrait to the next [m]
_MOST_EXPOSURES = 4
_RECORDING = "walk.html"
_OF_A_WALK = ("waveforms", "paths", "ground_reaction", "torques", "postures", "portrait")
_OF_SURVIVORS = ("coordinates",)
_OF_MEASURED = ("pareto",)  # Few walks of a study are.
_OF_A_NETWORK = ("network", "sensitivity")


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """The files that were written, and what is in them, for a command to print."""

    result: dict[str, Any]
    """The content of result.json."""
    best: StudyWalk | None
    """The furthest feasible walk, or the one nearest to feasible; None of a study without walks."""
    replayed: Walk | None
    """The same walk, with its history and measures."""
    network: Surrogate | None
    """The network of all walks, if enough survived."""
    files: tuple[str, ...]
    """Names of what is in the study's folder now, its figures as their folder."""


def write_report(folder: str | Path) -> StudyResult:
    """Write the report of the study in a folder, with its figures and recording.

    result.json gets the numbers of the network. A study that is still running is reported as far
    as it is. This takes some seconds, and loads torch, matplotlib and Drake.

    Args:
        folder: The study's folder.

    Raises:
        StudyError: it holds no study that can be read.
        GaitError: a file cannot be written.
    """
    folder = Path(folder)
    with Study.open(folder / "study.db") as study:
        known, settings, walks = study.description(), settings_with_robot(study), study.walks()
    written = write_outputs(
        settings,
        walks,
        folder,
        wall_s=known.get("wall_s", 0.0),
        proposer=known.get(PROPOSER),
    )
    return StudyResult.from_plain(written.result, folder)


def write_outputs(
    settings: StudySettings,
    walks: list[StudyWalk],
    folder: Path,
    *,
    wall_s: float,
    proposer: str | None = None,
) -> Outputs:
    """Write what a study's folder holds beside its walks: result, settings, recording, report.

    A study without walks has result.json and report.html only. A walk that cannot be simulated to
    its end has no recording. Files of an earlier report that are not made again go.

    Raises:
        GaitError: a file cannot be written.
    """
    searched = search_walks(walks)
    network, baselines = _learnt(settings, searched)
    robust = winner(settings, walks)
    objective = settings.search.objective
    best = robust.walk if robust else None
    if best is None and searched:
        best = best_walk(searched, settings.constraints, objective)
    how = walked_as(settings, best) if best else None
    replayed = simulate(best.candidate, how, history=True) if best else None
    measures = replayed.measures if replayed else None
    result: dict[str, Any] = plain({
        **summary(
            settings, walks, network, wall_s=wall_s, baselines=baselines, proposer=proposer
        ),
        "measures": asdict(measures) if measures else None,
        "jumps_deg": _jumps(best, settings.walk.start) if best else None,
        "quantities": _quantities(settings, best, replayed, how) if best else None,
    })  # fmt: skip
    write(folder / RESULT, to_json(result) + "\n")
    make_folder(folder / FIGURES)
    _forget_unmade(folder, searched, replayed, network)
    if best is not None and replayed is not None:
        _draw_walk(settings, best, replayed, folder)
        label = "winner" if robust else "best walk"
        _draw_search(settings, searched, best, folder / FIGURES, measured(walks), label)
    if network is not None:
        _draw_network(settings, network, folder / FIGURES)
    toml = write_study_toml(settings, folder)
    run = Run(folder=folder, settings=settings, result=result, walks=walks)
    write_study_page(run, folder / "report.html")
    return Outputs(
        result=result,
        best=best,
        replayed=replayed,
        network=network,
        files=_files(folder, toml.name),
    )


def _quantities(
    settings: StudySettings, best: StudyWalk, replayed: Walk | None, how: WalkSettings | None
) -> dict[str, Any]:
    """Return the quantities of the best walk; its own have been read when it was searched."""
    if replayed is None or how is None:
        return quantities_of(best.walk, settings.quantities)
    again = replace(replayed, values=best.walk.values)
    trial = Trial(candidate=best.candidate, settings=how)
    return quantities_of(evaluated(again, trial), settings.quantities)


def _jumps(best: StudyWalk, start: Start) -> dict[str, float]:
    gait = best.candidate.gait
    jumps = np.degrees(np.abs(gait.jumps_from(start))).max(axis=1).tolist()
    times = (f"{frame * FRAME_TIME:.1f} s" for frame in gait.walking)
    return dict(zip(times, jumps, strict=True))


def _forget_unmade(
    folder: Path, walks: Sequence[StudyWalk], replayed: Walk | None, network: Surrogate | None
) -> None:
    """Remove what an earlier report left and this one does not make: a page shows what it finds."""
    names = list(_OF_MEASURED)
    if replayed is None or replayed.history is None:
        names += _OF_A_WALK
        (folder / _RECORDING).unlink(missing_ok=True)
    if not any(walk.walk.survived for walk in walks):
        names += _OF_SURVIVORS
    if network is None:
        names += _OF_A_NETWORK
    for path in (folder / FIGURES / f"{name}{kind}" for name in names for kind in (".svg", ".png")):
        path.unlink(missing_ok=True)


def _files(folder: Path, toml: str) -> tuple[str, ...]:
    names = ("report.html", "result.json", _RECORDING, "study.db", toml)
    found = [name for name in names if (folder / name).is_file()]
    return (*found, *([FIGURES] if any((folder / FIGURES).iterdir()) else []))


def check_outputs(folder: Path) -> None:
    """Refuse a study's folder that could not take its report, before anything walks for it.

    Raises:
        GaitError: names what is in the way.
    """
    for name in ("result.json", "walk.html", "report.html"):
        check(folder / name)
    if (folder / FIGURES).exists():
        check(folder / FIGURES / PORTRAIT)


def _learnt(
    settings: StudySettings, walks: list[StudyWalk]
) -> tuple[Surrogate | None, Comparison | None]:
    """The network that all walks of the study give, and its baselines, if enough survived."""
    x, outputs, survived = training_data(walks, settings.space, settings.outputs)
    if surrogate.learnable(outputs, survived).sum() < surrogate.FEWEST_SURVIVORS:
        return None, None
    network = surrogate.fit(x, outputs, survived, seed=settings.seed)
    return network, compare(network, x, outputs, survived, seed=settings.seed)


def _draw_walk(settings: StudySettings, best: StudyWalk, replayed: Walk, folder: Path) -> None:
    """The recording, and the figures of one walk."""
    history, model = replayed.history, settings.walk.model
    if history is None:
        return
    caption = f"{settings.name}, walk {best.id}: {in_words(best.walk)}"
    record(replayed, best.candidate, folder / _RECORDING, model=model, caption=caption)
    target = folder / FIGURES
    walk_figures.waveforms(history, target / "waveforms")
    walk_figures.paths(history, target / "paths")
    walk_figures.ground_reaction(history, target / "ground_reaction")
    walk_figures.torques(history, target / "torques", stall_torques(model))
    frames = walk_figures.posture_frames(history)
    seen = pictures(history, frames, best.candidate, model=model)
    walk_figures.postures(history, seen, target / "postures")
    together = chronophotograph(history, _apart(history), best.candidate, model=model)
    save_picture(together, target / PORTRAIT)


def _apart(history: History) -> list[int]:
    """Frames, from first to last, in which the robot does not stand in its own way."""
    travelled = np.hypot(*(history.com[:, :2] - history.com[0, :2]).T)
    count = min(1 + int(travelled.max() / _ROOM), _MOST_EXPOSURES)
    places = np.linspace(0.0, travelled[-1], count)
    return [int(np.argmax(travelled >= place)) for place in places]


def _draw_search(
    settings: StudySettings,
    walks: list[StudyWalk],
    best: StudyWalk,
    folder: Path,
    found: Mapping[int, Measures],
    label: str,
) -> None:
    """Draw the figures of all walks, with the measures of some by their ids."""
    study_figures.convergence(
        [1e3 * walk.walk.forward if walk.walk.survived else np.nan for walk in walks],
        [settings.assess(walk.walk).feasible for walk in walks],
        folder / "convergence",
        samples=sum(walk.stage == "design" for walk in walks),
    )
    survivors = [walk for walk in walks if walk.walk.survived]
    if not survivors:
        return
    forward = [1e3 * walk.walk.forward for walk in survivors]
    feasible = [settings.assess(walk.walk).feasible for walk in survivors]
    study_figures.parallel_coordinates(
        [settings.space.encode(walk.candidate) for walk in survivors],
        forward,
        feasible,
        settings.space.encode(best.candidate),
        settings.space.names,
        folder / "coordinates",
        label=label,
    )
    costs = [found[walk.id].cost_of_transport if walk.id in found else np.nan for walk in survivors]
    if np.isfinite(costs).any():  # A study that wants distance measures its best walks only.
        study_figures.pareto(forward, costs, feasible, folder / "pareto")


def _draw_network(settings: StudySettings, network: Surrogate, folder: Path) -> None:
    """Draw the network's predictions, and what it says of the variables."""
    units = np.array([1e3, 1e3, np.degrees(1.0)])
    shown = [("Z", "mm"), ("X", "mm"), ("R", "deg")]
    columns = slice(0, len(shown))
    study_figures.predicted_against_simulated(
        network.targets[:, columns] * units,
        network.fitted[:, columns] * units,
        network.heldout[:, columns] * units,
        network.r2_train[columns].tolist(),
        network.r2_heldout[columns].tolist(),
        shown,
        folder / "network",
    )

    def distance(x: FloatArray) -> FloatArray:
        forward: FloatArray = network.predict(x).mean[:, 0]
        return forward

    found = sensitivity(distance, settings.space, seed=settings.seed)
    study_figures.sensitivity(found, folder / "sensitivity")
