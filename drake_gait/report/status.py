"""The status of a study, read from its folder while it runs or long after."""

import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drake_gait.errors import StudyError
from drake_gait.files.strict_json import from_json
from drake_gait.gait import plain_gait
from drake_gait.study._lock import is_driven
from drake_gait.study.ranking import feasible_walks, search_walks
from drake_gait.study.records import StudyWalk
from drake_gait.study.store import Study, study_file
from drake_gait.walk import Outcome

_FILE = "study.db"
_BEST = 8  # As many walks as the paper's Table II has.


@dataclass(frozen=True, kw_only=True)
class Status:
    """Status of a study when it was read."""

    folder: Path
    """Where it is."""
    state: str
    """`running` while a process works on it, else `finished` or `unfinished`."""
    settings: Mapping[str, Any]
    """What it was made with, by section.key, in SI units."""
    versions: Mapping[str, str]
    """The libraries that it was started with."""
    model_sha256: str
    """Fingerprint of its robot's file."""
    wall_s: float | None
    """Time on the clock up to the last stop [s]; None before the first."""
    stages: Mapping[str, int]
    """Walks by what they were simulated for."""
    survivors: int
    """Walks of the search whose robot stayed on its feet."""
    failures: Mapping[str, int]
    """The other walks by what kept them from their last frame; the frequent ones first."""
    feasible: int
    """Candidates whose walk satisfies every constraint."""
    best: tuple[StudyWalk, ...]
    """The best feasible walks of the search, at most eight."""
    result: Mapping[str, Any] | None
    """What result.json holds, if it is there."""

    @property
    def walks(self) -> int:
        """Walks of the search; those that confirm its best come on top."""
        return self.survivors + sum(self.failures.values())

    @property
    def total(self) -> int:
        """Walks that it may simulate."""
        return int(self.settings["search.simulations"])

    @property
    def name(self) -> str:
        """The study's name."""
        return str(self.settings["study.name"])

    @property
    def seed(self) -> int:
        """The study's seed."""
        return int(self.settings["study.seed"])

    @property
    def mode(self) -> str | None:
        """The mode of its search, if its version had several."""
        return self.settings.get("search.mode")

    @property
    def r2_heldout(self) -> Mapping[str, float | None]:
        """Held-out R² of the network of all walks, by output; empty without a result of them."""
        if self.result is None or self.result.get("simulations") != self.walks:
            return {}
        found = self.result.get("r2_heldout")
        numbers = found.items() if isinstance(found, dict) else ()
        return {name: r2 for name, r2 in numbers if r2 is None or isinstance(r2, (int, float))}

    @property
    def remark(self) -> str | None:
        """Why nothing is known of its gaits, in a sentence; None if something is."""
        if not self.walks:
            return "no walk has been simulated yet"
        if self.survivors or str(Outcome.FELL) in self.failures:
            return None
        causes = ", ".join(f"{cause} {count}" for cause, count in self.failures.items())
        return f"none of its {self.walks} walks could be simulated to an end ({causes})"

    def plain(self) -> dict[str, Any]:
        """All of it as JSON has it; lengths in m, angles in rad."""
        return {
            "folder": str(self.folder),
            "name": self.name,
            "seed": self.seed,
            "mode": self.mode,
            "state": self.state,
            "walks": self.walks,
            "total": self.total,
            "survivors": self.survivors,
            "feasible": self.feasible,
            "remark": self.remark,
            "best": [_plain_walk(walk) for walk in self.best],
            "stages": dict(self.stages),
            "failures": dict(self.failures),
            "wall_s": self.wall_s,
            "settings": dict(self.settings),
            "versions": dict(self.versions),
            "model_sha256": self.model_sha256,
            "result": self.result,
        }


def read_status(path: str | Path) -> Status:
    """Return the status of the study in a folder; a running one is not disturbed.

    Raises:
        StudyError: there is no study, or it cannot be read.
    """
    file = study_file(path)
    running = is_driven(file)
    with Study.open(file) as study:
        description, settings, walks = study.description(), study.settings(), study.walks()
    ended = "finished" if "finished" in description else "unfinished"
    feasible = feasible_walks(walks, settings.constraints, settings.search.objective)
    failures = Counter(walk.walk.failure for walk in search_walks(walks))
    return Status(
        folder=file.parent,
        state="running" if running else ended,
        settings=description["settings"],
        versions=description.get("versions", {}),
        model_sha256=description["model_sha256"],
        wall_s=description.get("wall_s"),
        stages=Counter(walk.stage for walk in walks),
        survivors=failures.pop(None, 0),
        failures={str(cause): count for cause, count in failures.most_common()},
        feasible=len(feasible),
        best=tuple(feasible[:_BEST]),
        result=_result(file.parent / "result.json"),
    )


def studies_in(folder: Path) -> tuple[list[Path], dict[Path, str]]:
    """Folders of all studies in a folder and below, in order, and folders that cannot be read.

    Returns:
        The studies' folders, and by its path why a folder cannot be looked into.

    Raises:
        StudyError: there is nothing of either.
    """
    unreadable: dict[Path, str] = {}

    def note(error: OSError) -> None:
        unreadable[Path(error.filename)] = f"{error.filename}: {error.strerror}"

    found = [
        Path(path)
        for path, folders, files in os.walk(folder, onerror=note)
        if _FILE in files or _FILE in folders
    ]
    found = [path for path in found if path.name != _FILE]  # What is in a folder of this name.
    if unreadable.keys() == {folder} or not (found or unreadable):
        why = unreadable.get(folder)
        raise StudyError(
            f"no study in {folder} or below{f' ({why})' if why else ''}; "
            "`python -m drake_gait.optimize` makes one in runs"
        )
    return sorted(found), unreadable


def _result(path: Path) -> dict[str, Any] | None:
    try:
        found = from_json(path.read_bytes())
    except (OSError, ValueError):
        return None  # Not there yet, or being written.
    return found if isinstance(found, dict) else None


def _plain_walk(entry: StudyWalk) -> dict[str, Any]:
    walk = entry.walk
    return {
        "walk": entry.id,
        "stage": entry.stage,
        "forward": walk.forward,
        "lateral": walk.lateral,
        "yaw": walk.yaw,
        "com_height": walk.com_height,
        "frames": walk.frames,
        **plain_gait(entry.candidate.gait),
        "foot": asdict(entry.candidate.foot),
    }
