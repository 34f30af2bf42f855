"""The files of a study's folder beside study.db: its report and all that is in it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drake_gait.files.destination import check, make_folder, write
from drake_gait.files.strict_json import plain, to_json
from drake_gait.gait import FRAME_TIME, FloatArray, Start
from drake_gait.problem import Trial, evaluated
from drake_gait.report.kept import MADE, Kept, fingerprint
from drake_gait.report.page import FIGURES, PORTRAIT, Run, write_study_page
from drake_gait.report.result import in_words, scores, summary
from drake_gait.report.study_result import RESULT, StudyResult, measures_from, quantities_of
from drake_gait.robot.description import read_model
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
from drake_gait.surrogates.prediction import FEWEST_SURVIVORS, learnable
from drake_gait.visualization import study as study_figures
from drake_gait.visualization import walk as walk_figures
from drake_gait.visualization.portraits import chronophotograph, pictures
from drake_gait.visualization.recording import record
from drake_gait.visualization.style import FORMATS, save_picture
from drake_gait.walk import History, Measures, Walk, WalkSettings

if TYPE_CHECKING:  # It loads torch, which a report that only is written again need not.
    from drake_gait.surrogates.ensemble import Surrogate

LEARNT_FROM = 1000
"""Latest walks that the network of its report learns, so that a long search has it soon."""

_ROOM = 0.17  # from one exposure of a portrait to the next [m]
_MOST_EXPOSURES = 4
_RECORDING = "walk.html"
_OF_A_WALK = ("waveforms", "paths", "ground_reaction", "torques", "postures", "portrait")
_OF_A_SEARCH = ("convergence", "coordinates", "pareto")
_OF_A_NETWORK = ("network", "sensitivity")


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """Shares of the variance that the network of a report explains."""

    r2_train: FloatArray
    """On the walks that it has learnt from, shape (k,)."""
    r2_heldout: FloatArray
    """On walks that it has not seen, shape (k,)."""
    walks: int
    """Walks that it has learnt from, the fallen ones too."""


@dataclass(frozen=True, kw_only=True)
class Outputs:
    """The files that were written, and what is in them, for a command to print."""

    result: dict[str, Any]
    """The content of result.json."""
    best: StudyWalk | None
    """The furthest feasible walk, or the one nearest to feasible; None of a study without walks."""
    measures: Measures | None
    """Measures of that walk, if it was simulated to its end."""
    network: Explained | None
    """Scores of the network of the latest walks, if enough survived."""
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
    learnt_from: int = LEARNT_FROM,
) -> Outputs:
    """Write what a study's folder holds beside its walks: result, settings, recording, report.

    The page stands as soon as the walk and the search are drawn. It is written once more with the
    network and its baselines. Parts that would come out as they are stay.

    A study without walks has result.json and report.html only. A walk that cannot be simulated to
    its end has no recording. Files of an earlier report that are not made again go.

    Args:
        settings: The study.
        walks: All its walks.
        folder: Its folder.
        wall_s: Time that it took [s].
        proposer: What searched it, where that is not the proposer of its mode.
        learnt_from: Walks of the search, the latest, that the network learns.

    Raises:
        GaitError: a file cannot be written.
    """
    searched = search_walks(walks)
    robust = winner(settings, walks)
    best = robust.walk if robust else None
    if best is None and searched:
        best = best_walk(searched, settings.constraints, settings.search.objective)
    kept = Kept.read(folder)
    result: dict[str, Any] = plain({
        **summary(settings, walks, None, wall_s=wall_s, proposer=proposer),
        "measures": None,
        "jumps_deg": None,
        "quantities": None,
    })  # fmt: skip
    make_folder(folder / FIGURES)
    if best is not None:
        result |= _walk_part(settings, best, kept)
        _search_part(settings, walks, best, "winner" if robust else "best walk", kept)
    latest = searched[-learnt_from:]
    learnt, learn = _network_part(settings, latest, kept)
    _forget_unmade(kept)
    toml = write_study_toml(settings, folder)
    page = Run(folder=folder, settings=settings, result=result, walks=walks)
    if learn is not None:
        result[MADE] = kept.plain()
        _present(page)
        learnt = learn()
    result |= {**(learnt or {}), MADE: kept.plain()}
    _present(page)
    return Outputs(
        result=result,
        best=best,
        measures=measures_from(result["measures"]) if result["measures"] else None,
        network=_explained(result, len(latest)) if learnt else None,
        files=_files(folder, toml.name),
    )


def _present(page: Run) -> None:
    """Write result.json and the page, as far as they are known."""
    write(page.folder / RESULT, to_json(page.result) + "\n")
    write_study_page(page, page.folder / "report.html")


def _walk_part(settings: StudySettings, best: StudyWalk, kept: Kept) -> dict[str, Any]:
    """Draw and record a walk; returns what result.json says of it."""
    how, start = walked_as(settings, best), settings.walk.start
    gait = best.candidate.gait
    made_from = fingerprint(
        (settings.name, best.id, best.walk, best.candidate.foot),
        (gait.variables, gait.commands_from(start), gait.schedule),
        replace(how, model=read_model(settings.walk.model).sha256),
        [one.plain() for one in settings.quantities],
    )
    if (found := kept.found("walk", made_from)) is not None:
        return found
    replayed = simulate(best.candidate, how, history=True)
    files = []
    if replayed.history is not None:
        _draw_walk(settings, best, replayed, kept.folder)
        files = [_RECORDING, *_files_of(_OF_A_WALK)]
    said = {
        "measures": asdict(replayed.measures) if replayed.measures else None,
        "jumps_deg": _jumps(best, start),
        "quantities": _quantities(settings, best, replayed, how),
    }
    return kept.keep("walk", made_from, plain(said), files)


def _search_part(
    settings: StudySettings, walks: Sequence[StudyWalk], best: StudyWalk, label: str, kept: Kept
) -> None:
    """Draw the figures of all walks."""
    searched, found = search_walks(walks), measured(walks)
    survivors = [walk for walk in searched if walk.walk.survived]
    drawn = _Search(
        forward_mm=np.array(
            [1e3 * one.walk.forward if one.walk.survived else np.nan for one in searched]
        ),
        feasible=np.array([settings.assess(walk.walk).feasible for walk in searched]),
        survived=np.array([walk.walk.survived for walk in searched]),
        samples=sum(walk.stage == "design" for walk in searched),
        x=np.array([settings.space.encode(walk.candidate) for walk in survivors]),
        costs=np.array(
            [found[walk.id].cost_of_transport if walk.id in found else np.nan for walk in survivors]
        ),
        best=settings.space.encode(best.candidate),
        names=settings.space.names,
        label=label,
    )
    made_from = fingerprint(drawn)
    if kept.found("search", made_from) is None:
        for name in _files_of(_OF_A_SEARCH):
            (kept.folder / name).unlink(missing_ok=True)  # Few studies have all of them.
        _draw_search(drawn, kept.folder / FIGURES)
        kept.keep("search", made_from, {}, _files_of(_OF_A_SEARCH))


def _network_part(
    settings: StudySettings, walks: Sequence[StudyWalk], kept: Kept
) -> tuple[dict[str, Any] | None, Callable[[], dict[str, Any]] | None]:
    """Return what result.json says of the network and its baselines, or what learns and draws it.

    Both are None of walks that nothing can be learnt from.
    """
    x, outputs, survived = training_data(walks, settings.space, settings.outputs)
    space = settings.space
    names = [one.name for one in settings.outputs]
    made_from = fingerprint(x, outputs, survived, settings.seed, names, space.names)
    if (found := kept.found("network", made_from)) is not None:
        return found, None

    if learnable(outputs, survived).sum() < FEWEST_SURVIVORS:
        return None, None

    def learn() -> dict[str, Any]:
        from drake_gait.surrogates import ensemble
        from drake_gait.surrogates.baselines import compare

        network = ensemble.fit(x, outputs, survived, seed=settings.seed)
        _draw_network(settings, network, kept.folder / FIGURES)
        beside = compare(network, x, outputs, survived, seed=settings.seed)
        said = plain(scores(network, beside, names))
        return kept.keep("network", made_from, said, _files_of(_OF_A_NETWORK))

    return None, learn


def _explained(result: Mapping[str, Any], walks: int) -> Explained:
    """Return the scores of a network that result.json has."""
    train, heldout = (
        np.array([np.nan if one is None else one for one in result[key].values()])
        for key in ("r2_train", "r2_heldout")
    )
    return Explained(r2_train=train, r2_heldout=heldout, walks=walks)


def _files_of(figures: Sequence[str]) -> list[str]:
    """Names of figures in a study's folder, in every format that they may have."""
    return [f"{FIGURES}/{name}{ending}" for name in figures for ending in FORMATS]


def _quantities(
    settings: StudySettings, best: StudyWalk, replayed: Walk, how: WalkSettings
) -> dict[str, Any]:
    """Return the quantities of the best walk; its own have been read when it was searched."""
    again = replace(replayed, values=best.walk.values)
    trial = Trial(candidate=best.candidate, settings=how)
    return quantities_of(evaluated(again, trial), settings.quantities)


def _jumps(best: StudyWalk, start: Start) -> dict[str, float]:
    gait = best.candidate.gait
    jumps = np.degrees(np.abs(gait.jumps_from(start))).max(axis=1).tolist()
    times = (f"{frame * FRAME_TIME:.1f} s" for frame in gait.walking)
    return dict(zip(times, jumps, strict=True))


def _forget_unmade(kept: Kept) -> None:
    """Remove what an earlier report left and this one has not made: a page shows what it finds."""
    every = {_RECORDING, *_files_of((*_OF_A_WALK, *_OF_A_SEARCH, *_OF_A_NETWORK))}
    for name in every - kept.files:
        (kept.folder / name).unlink(missing_ok=True)


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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Search:
    """Numbers that the figures of all walks are drawn from."""

    forward_mm: FloatArray
    """Distance of every walk [mm], shape (n,); NaN of one that fell."""
    feasible: NDArray[np.bool_]
    """Whether each is feasible, shape (n,)."""
    survived: NDArray[np.bool_]
    """Whether each survived, shape (n,)."""
    samples: int
    """Walks of the design of experiments."""
    x: FloatArray
    """Design vectors of the survivors, shape (m, d)."""
    costs: FloatArray
    """Cost of transport of the survivors, shape (m,); NaN where it was not measured."""
    best: FloatArray
    """Design vector of the walk on top, shape (d,)."""
    names: Sequence[str]
    """The design variables."""
    label: str
    """What the walk on top is called."""


def _draw_search(drawn: _Search, folder: Path) -> None:
    """Draw the figures of all walks, with the measures of some."""
    study_figures.convergence(
        drawn.forward_mm, drawn.feasible, folder / "convergence", samples=drawn.samples
    )
    if not drawn.survived.any():
        return
    forward, feasible = drawn.forward_mm[drawn.survived], drawn.feasible[drawn.survived]
    study_figures.parallel_coordinates(
        drawn.x,
        forward,
        feasible,
        drawn.best,
        drawn.names,
        folder / "coordinates",
        label=drawn.label,
    )
    if np.isfinite(drawn.costs).any():  # A study that wants distance measures its best walks only.
        study_figures.pareto(forward, drawn.costs, feasible, folder / "pareto")


def _draw_network(settings: StudySettings, network: "Surrogate", folder: Path) -> None:
    """Draw the network's predictions, and what it says of the variables."""
    from drake_gait.surrogates.sensitivity import sensitivity

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
