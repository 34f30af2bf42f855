"""The winner of an earlier study, which a new one begins at: its gait and its foot.

It is found in result.json, in study.db, or in the folder that holds them; `study.db` counts there,
as it is the study itself.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drake_gait.errors import SettingsError, StudyError
from drake_gait.files.strict_json import from_json
from drake_gait.foot import FootDesign
from drake_gait.gait import AnyGait, Gait, gait_of
from drake_gait.study._toml import as_toml
from drake_gait.study.finalists import winner
from drake_gait.study.keys import FOOT
from drake_gait.study.ranking import best_walk, search_walks
from drake_gait.study.store import Study

if TYPE_CHECKING:  # Settings are read from a winner.
    from drake_gait.study.settings import StudySettings

_DATABASE = b"SQLite format 3\0"


@dataclass(frozen=True, kw_only=True, eq=False)
class EarlierWinner:
    """The gait and the foot of a study's winner, or of its best walk."""

    coefficients_deg: Any
    """Coefficients [degrees], 4 rows of 4, not checked yet; None of another family's gait."""
    gait: AnyGait | None = None
    """The gait of another family than the paper's."""
    foot: Mapping[str, Any] | None
    """Keys of a study's [foot] with their values; None where no foot is told."""


def earlier_winner(
    path: Path, settings_of: Callable[[Mapping[str, Any]], "StudySettings"]
) -> EarlierWinner:
    """Return the winner of the study that a path names.

    Args:
        path: A study's folder, its study.db or its result.json.
        settings_of: Makes settings of a study's description.

    Raises:
        SettingsError: it cannot be read, is none of these, or the study has no walk yet.
    """
    path = path.expanduser()
    if path.is_dir():
        path = next(
            (file for file in (path / "study.db", path / "result.json") if file.is_file()),
            path / "result.json",
        )
    try:
        with path.open("rb") as file:
            is_database = file.read(len(_DATABASE)) == _DATABASE
        content = b"" if is_database else path.read_bytes()
    except OSError as error:
        raise SettingsError(
            f"cannot read the result {path}: {error.strerror}; give a study's folder, its study.db "
            "or its result.json"
        ) from None
    found = _of_database(path, settings_of) if is_database else _of_result(path, content)
    if found is None:
        raise SettingsError(f"the study in {path} has no walk yet that another one can begin at")
    return found


def _of_database(
    path: Path, settings_of: Callable[[Mapping[str, Any]], "StudySettings"]
) -> EarlierWinner | None:
    try:
        with Study.open(path) as study:
            settings, walks = settings_of(study.description()["settings"]), study.walks()
    except StudyError as error:
        raise SettingsError(str(error)) from None
    searched = search_walks(walks)
    if not searched:
        return None
    robust = winner(settings, walks)
    best = robust.walk if robust else None
    if best is None:
        best = best_walk(searched, settings.constraints, settings.search.objective)
    gait = best.candidate.gait
    # As result.json has them, so that both begin at the same gait to the last digit.
    return EarlierWinner(
        coefficients_deg=gait.degrees.tolist() if isinstance(gait, Gait) else None,
        gait=None if isinstance(gait, Gait) else gait,
        foot=foot_in_file(asdict(best.candidate.foot)),
    )


def _of_result(path: Path, content: bytes) -> EarlierWinner | None:
    try:
        result = from_json(content)
        coefficients, foot = result["coefficients_deg"], result.get("foot")
        best = None if coefficients else result.get("best")
        told = None if foot is None else foot_in_file(asdict(FootDesign(**foot)))
    except SettingsError as error:
        raise SettingsError(f"{path} has a foot that cannot be used: {error}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise SettingsError(
            f"{path} is no result.json of a study; give one, a study.db or a study's folder"
        ) from None
    if coefficients:
        return EarlierWinner(coefficients_deg=coefficients, foot=told)
    try:
        return best and EarlierWinner(
            coefficients_deg=None, gait=gait_of(best["candidate"]), foot=told
        )
    except (SettingsError, KeyError, TypeError) as error:
        raise SettingsError(f"{path} has a gait that cannot be used: {error}") from None


def foot_in_file(foot: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a foot, in SI units, as keys of a study's [foot] with their values."""
    # Through text, so that a study written again has the same numbers to the last digit.
    told: dict[str, Any] = {
        key: float(as_toml(float(foot[field]), unit)) for key, (field, unit) in FOOT.items()
    }
    return {**told, "rigid_toes": bool(foot["rigid_toes"])}
