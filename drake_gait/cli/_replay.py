"""The work of `replay`: walk again, and write or show a recording."""

import dataclasses
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.geometry import Meshcat

from drake_gait.errors import StudyError
from drake_gait.files.destination import messages
from drake_gait.files.shipped import find
from drake_gait.report.result import in_words
from drake_gait.search.confirmation import walked_as
from drake_gait.simulation.simulate import simulate
from drake_gait.study.finalists import winner
from drake_gait.study.ranking import best_walk, search_walks
from drake_gait.study.records import CONFIRMATIONS, StudyWalk
from drake_gait.study.robot import settings_with_robot
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study
from drake_gait.visualization.live import Screen
from drake_gait.visualization.meshcat import with_meshcat
from drake_gait.visualization.recording import Exhibit, record, record_gallery
from drake_gait.walk import Engine, Walk, WalkSettings

if TYPE_CHECKING:
    from drake_gait.cli.replay import Options


def work(options: "Options") -> None:
    """Do what the command line says."""
    if options.out is None:
        _watch(options)
        return
    if options.gallery is None and not options.rigid_toes and options.engine != "both":
        _replay(options, options.out)
    else:
        _show_side_by_side(options, options.out)


def _replay(options: "Options", out: Path) -> None:
    folder = options.folder
    settings, chosen, as_then = choose(folder, options.walk)
    ((words, how),) = _engines(options, as_then)
    walk = simulate(chosen.candidate, how, history=True)
    if walk.history is None:
        raise StudyError(
            f"walk {chosen.id} of {folder} cannot be recorded, {in_words(walk)}; give another "
            "--walk"
        )
    caption = f"{settings.name}, walk {chosen.id}{words}: {in_words(walk)}"
    record(walk, chosen.candidate, out, model=settings.walk.model, caption=caption)
    print(f"{out}: {caption}", file=messages(out))
    if how == as_then:
        _warn_of_difference(folder, walk, chosen)


def _engines(options: "Options", how: WalkSettings) -> list[tuple[str, WalkSettings]]:
    """Return how a walk is simulated in each engine that is asked for, and in words which."""
    if options.engine is None:
        return [("", how)]
    wanted = list(_ENGINES) if options.engine == "both" else [Engine(options.engine)]
    return [(f" {_ENGINES[one]}", dataclasses.replace(how, engine=one)) for one in wanted]


_ENGINES = {Engine.DRAKE: "in Drake", Engine.MUJOCO: "in MuJoCo"}


def _show_side_by_side(options: "Options", out: Path) -> None:
    exhibits = []
    for folder in [options.folder, *(options.gallery or [])]:
        number = options.walk if folder == options.folder else None
        settings, chosen, as_then = choose(folder, number)
        candidates = {"": chosen.candidate}
        if options.rigid_toes:
            stiff = dataclasses.replace(chosen.candidate.foot, rigid_toes=True)
            candidates[", rigid toes"] = dataclasses.replace(chosen.candidate, foot=stiff)
        variants = [
            (toes + words, candidate, how)
            for toes, candidate in candidates.items()
            for words, how in _engines(options, as_then)
        ]
        for words, candidate, how in variants:
            walk = simulate(candidate, how, history=True)
            if walk.history is None:
                raise StudyError(
                    f"walk {chosen.id} of {folder}{words} cannot be recorded, {in_words(walk)}; "
                    "give another --walk, or leave that study out"
                )
            if candidate == chosen.candidate and how == as_then:
                _warn_of_difference(folder, walk, chosen)
            ending = in_words(walk) if options.engine == "both" else _ending(walk)
            label = f"{folder.resolve().name}, walk {chosen.id}{words}: {ending}"
            exhibits.append(
                Exhibit(walk=walk, candidate=candidate, label=label, model=settings.walk.model)
            )
            print(label, file=messages(out))
    record_gallery(exhibits, out, caption=f"{len(exhibits)} walks at the same time")
    print(out, file=messages(out))


def _watch(options: "Options") -> None:
    settings, chosen, as_then = choose(options.folder, options.walk)
    ((words, how),) = _engines(options, as_then)

    def play(meshcat: Meshcat) -> None:
        screen = Screen(meshcat, settings.walk.model, chosen.candidate.foot)
        print(f"open {meshcat.web_url()} to watch; Ctrl-C ends it", flush=True)
        while meshcat.GetNumActiveConnections() == 0:
            time.sleep(0.1)
        walk = simulate(chosen.candidate, how, watch=screen.show)
        print(f"{settings.name}, walk {chosen.id}{words}: {in_words(walk)}", flush=True)
        while meshcat.GetNumActiveConnections() > 0:  # until its last reader has gone
            time.sleep(0.1)

    with_meshcat(play, options.port)


def choose(folder: Path, number: int | None) -> tuple[StudySettings, StudyWalk, WalkSettings]:
    """A study's settings, one of its walks (the winner if None), and how that was simulated.

    Raises:
        StudyError: there is no such study or walk, or another robot walked it.
    """
    with Study.open(find(folder) / "study.db") as study:
        settings = settings_with_robot(study)
        walks = study.walks()
    if not walks:
        raise StudyError(f"{folder} has no walks yet")
    if number is None:
        robust, objective = winner(settings, walks), settings.search.objective
        chosen = robust.walk if robust else best_walk(walks, settings.constraints, objective)
    else:
        chosen = _find(walks, number)
    return settings, chosen, walked_as(settings, chosen)


def _warn_of_difference(folder: Path, walk: Walk, chosen: StudyWalk) -> None:
    if in_words(walk) != in_words(chosen.walk):
        print(
            f"warning: the study in {folder} has {in_words(chosen.walk)} for it; other versions or "
            "another processor walk otherwise",
            file=sys.stderr,
        )


def _ending(walk: Walk) -> str:
    """The distance, or why there is none, as text."""
    return f"{1e3 * walk.forward:.1f} mm" if walk.survived else walk.reason


def _find(walks: list[StudyWalk], number: int) -> StudyWalk:
    for walk in walks:
        if walk.id == number:
            return walk
    last = max(walk.id for walk in search_walks(walks))
    raise StudyError(
        f"no walk {number}; the study has walks 0 to {last}, and from {CONFIRMATIONS} on those "
        "that confirm"
    )
