"""The robot of a study, which is kept in it: what walked is known wherever the study is."""

from dataclasses import replace

from drake_gait.errors import ModelError, StudyError
from drake_gait.robot.description import RobotModel, read_model
from drake_gait.study.settings import StudySettings
from drake_gait.study.store import Study

ROBOT = "robot"
"""Key of a study under which its robot is."""


def settings_with_robot(study: Study) -> StudySettings:
    """Read the settings of a study, its robot as it was when the study began.

    Raises:
        StudyError: the study keeps no robot, as older ones, and its file is another one by now.
    """
    settings = study.settings()
    return with_robot(settings, study)


def with_robot(settings: StudySettings, study: Study) -> StudySettings:
    """Return settings whose robot is the one that a study walks, whatever became of its file.

    Raises:
        StudyError: see `settings_with_robot`.
    """
    return replace(settings, walk=replace(settings.walk, model=robot_of(study)))


def robot_of(study: Study) -> RobotModel:
    """Return the robot that a study walks.

    Raises:
        StudyError: see `settings_with_robot`.
    """
    description = study.description()
    try:
        kept = description.get(ROBOT)
        if kept is None:
            known = description["settings"]
            found = read_model(known["walk.model"], known.get("robot.file", ""))
        else:
            found = RobotModel.from_plain(kept)
    except ModelError as error:
        raise StudyError(f"{study.path}: {error}") from None
    if found.sha256 != description["model_sha256"]:
        raise StudyError(
            f"{study.path.parent} holds walks of another version of {found}: the file has changed "
            "since, and the study keeps no robot; put back the file that it began with"
        )
    return found
