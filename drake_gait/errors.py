"""Errors that a user can cure, as one tree.

    GaitError                 every error below; a command prints its text and exits with status 2
    ├── SettingsError         a value that was given is not one that can be used
    ├── ModelError            a robot description cannot be read, or is not the robot that is needed
    ├── StudyError            a study's folder or file cannot be used, or belongs to another study
    ├── WorkerError           the processes that run walks cannot be kept alive
    └── HardwareError         a robot's controller does not do what it is asked to

A robot that falls or a solver that diverges is no error but the `Outcome` of a walk; a bug is any
other exception.
"""


class GaitError(Exception):
    """An error whose text names the value at fault and the cure."""


class SettingsError(GaitError, ValueError):
    """A value given by the user is not one that can be used."""


class ModelError(GaitError):
    """A robot description cannot be read, or is not the robot that is needed."""


class StudyError(GaitError):
    """A study's folder or file cannot be used, or belongs to another study."""


class WorkerError(GaitError):
    """The processes that run walks cannot be kept alive."""


class HardwareError(GaitError):
    """A robot's controller does not do what it is asked to."""
