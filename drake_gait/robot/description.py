"""Robot descriptions: where they are, and what one is once it has been read.

A robot is its content. `read_model` reads a file and the meshes that it names, once. The
`RobotModel` walks, is cached and is kept in a study, whatever becomes of the file.
"""

import base64
import hashlib
import json
import os
import re
import tempfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from drake_gait.errors import ModelError, SettingsError
from drake_gait.robot.robot_file import (
    RobotFile,
    default_robot,
    is_robot_file,
    parsed,
    read_robot_file,
    robot_path,
    shipped_robots,
)
from drake_gait.robot.sdf import Format
from drake_gait.robot.sdf_checks import checked, named_files
from drake_gait.servo import Servo
from drake_gait.walk import DEFAULT_MODEL, WalkSettings

_MESHES = (".obj", ".gltf", ".vtk")
"""Kinds of meshes that Drake computes with and shows."""

_SCHEME = re.compile(r"([a-z][a-z0-9+.-]*)://(.*)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """A file beside a robot description: a mesh, or what a mesh needs."""

    path: str
    """Where it is among the others, when they are unpacked into one folder."""
    content: bytes = field(repr=False)
    """Its bytes."""
    uri: str = ""
    """How the description names it; empty for what a mesh needs."""
    collides: bool = False
    """Whether a walk needs it; others are only seen."""


@dataclass(frozen=True, kw_only=True)
class RobotModel:
    """A robot description as it was read; two are equal if their content is."""

    name: str = field(compare=False)
    """How the user names it, for messages."""
    content: bytes = field(compare=False, repr=False)
    """The bytes of the model's file."""
    robot: RobotFile = field(default_factory=default_robot, compare=False, repr=False)
    """The robot's file: names and numbers beside the model."""
    files: tuple[ModelFile, ...] = field(default=(), compare=False, repr=False)
    """The meshes that it names, with all that they need."""
    sha256: str
    """Fingerprint of the model, its meshes and, unless it is the KHR-3HV's, the robot's file."""

    def __str__(self) -> str:
        return self.name

    @property
    def format(self) -> Format:
        """Return the format of its model."""
        return checked(self.content, self.robot).format

    @property
    def place(self) -> str:
        """Return how a message about its model begins."""
        return f"{self.name}: {self.robot.model}" if is_robot_file(self.name) else self.name

    def for_walks(self) -> "RobotModel":
        """The same robot without the files that are only seen, for a worker."""
        needed = tuple(file for file in self.files if file.collides)
        return self if len(needed) == len(self.files) else replace(self, files=needed)

    def plain(self) -> dict[str, Any]:
        """All of it as JSON has it: the file as text where it is UTF-8, the rest compressed."""
        try:
            content: str | None = self.content.decode()
        except UnicodeDecodeError:
            content = None
        others = [
            {
                "path": file.path,
                "uri": file.uri,
                "collides": file.collides,
                "content": _packed(file.content),
            }
            for file in self.files
        ]
        text = {"text": content} if content is not None else {"content": _packed(self.content)}
        return {
            "name": self.name,
            "sha256": self.sha256,
            **text,
            "files": others,
            "robot": self.robot.text,
        }

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> "RobotModel":
        """The robot that `plain` was taken from.

        Raises:
            ModelError: it was taken from none, or has been changed since.
        """
        try:
            text = plain.get("text")
            content = _unpacked(plain["content"]) if text is None else text.encode()
            others = tuple(
                ModelFile(**{**file, "content": _unpacked(file["content"])})
                for file in plain["files"]
            )
            # Older studies keep no robot's file: they walk the KHR-3HV.
            text = plain.get("robot")
            robot = default_robot() if text is None else parsed(text, "the robot's file")
            sha256 = plain["sha256"]
            # It is left out of that of a KHR-3HV, as that of its time was.
            intact = sha256 in (_sha256(content, others, robot), _sha256(content, others))
            found = cls(
                name=plain["name"], content=content, files=others, robot=robot, sha256=sha256
            )
        except (AttributeError, KeyError, ModelError, TypeError, ValueError, zlib.error):
            intact = False
        if not intact:
            raise ModelError("the robot that the study keeps is damaged; put back a copy")
        return found


Model = str | Path | RobotModel
"""A robot: a path or the name of a shipped one, of a robot's file or of a model; or one read."""


def models_folder() -> Path:
    """Folder of the robot descriptions: inside an installed package, or beside it in a checkout."""
    inside = Path(str(files("drake_gait"))) / "models"
    return inside if inside.is_dir() else inside.parents[1] / "models"


def model_path(model: str | Path = DEFAULT_MODEL) -> Path:
    """Path of a robot description, given as a file or as the name of one that is shipped.

    A bare name that is one of a shipped robot means that one; `./khr3hv.sdf` is a file.

    Raises:
        ModelError: there is no such file.
    """
    shipped = _shipped(str(model))
    path = shipped or Path(model)
    if not path.is_file():
        there = path.exists()
        raise ModelError(
            f"robot description '{model}' is no file; give an SDF, URDF, MJCF or robot's file"
            if there
            else f"no robot description '{model}'; give a path to an SDF, URDF, MJCF or robot's "
            f"file, or one of {', '.join(_shipped_names())}"
        )
    return path


def located(model: str, folder: Path, key: str = "walk.model") -> str:
    """A robot's name that means the same from any folder.

    Args:
        model: As somebody wrote it: a shipped robot's name, or a path.
        folder: Where a path begins: the folder of the file that names it.
        key: The setting that names it, for messages.

    Raises:
        SettingsError: it is the name of a shipped robot, and of another one in this folder.
    """
    beside = folder / model
    if shipped := _shipped(model):
        try:
            other = beside.is_file() and beside.read_bytes() != shipped.read_bytes()
        except OSError:
            other = False
        if other:
            raise SettingsError(
                f"{key} = '{model}' is a shipped robot and another one in {folder}; write "
                f"'./{model}' for the one in the folder, or rename it"
            )
        return model
    return os.path.normpath(beside.absolute()) if model else model


def _shipped(model: str) -> Path | None:
    """Path of the shipped robot of this name."""
    if model in shipped_robots():
        return robot_path(model)
    return models_folder() / model if model in _shipped_names() else None


def _shipped_names() -> list[str]:
    models = sorted(path.name for path in models_folder().glob("*.sdf"))
    return [*models, *shipped_robots()]


def read_model(model: Model = DEFAULT_MODEL, robot: str | Path = "") -> RobotModel:
    """Read a robot: its file, its model, and the meshes that the model names.

    Args:
        model: The robot's file, or its model.
        robot: The robot's file of a model; that of the KHR-3HV by default.

    Raises:
        ModelError: there is no such file, it is no robot's, or a mesh cannot be read.
    """
    if isinstance(model, RobotModel):
        return model
    if is_robot_file(model):
        if robot:
            raise ModelError(f"'{model}' and '{robot}' are two robot's files; give one of them")
        told = read_robot_file(model)
        path = _model_of(told, robot_path(model))
    else:
        told = read_robot_file(robot) if robot else default_robot()
        path = model_path(model)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(f"cannot read {path}: {error.strerror}") from None
    try:
        found = _files(content, path.absolute().parent, told)
    except ModelError as error:
        raise ModelError(f"{path}{error}") from None
    return RobotModel(
        name=str(model),
        content=content,
        robot=told,
        files=found,
        sha256=_sha256(content, found, told),
    )


def robot_of(model: Model, robot: str | Path = "") -> RobotFile:
    """Return the robot's file of what `read_model` reads, without reading the model.

    Raises:
        ModelError: there is none, or it cannot be used.
    """
    if isinstance(model, RobotModel):
        return model.robot
    if is_robot_file(model):
        return read_robot_file(model)
    return read_robot_file(robot) if robot else default_robot()


def servo_of(settings: WalkSettings) -> Servo:
    """Return the servos of a walk: its own, or those of its robot's file.

    Raises:
        ModelError: the robot's file cannot be used.
    """
    return settings.servo or robot_of(settings.model, settings.robot).servo


def _model_of(robot: RobotFile, path: Path) -> Path:
    """Path of the model that a robot's file names, beside it or in a package."""
    try:
        return _resolved(robot.model, path.absolute().parent, "model =")
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None


UNPACKED = "drake_gait_unpacked"
"""Package in which Drake finds the files of a robot."""


@contextmanager
def files_of(model: RobotModel, *, looks: bool) -> Iterator[tuple[Path | None, dict[str, str]]]:
    """A folder with a robot's files, and what their URIs in it are.

    With `looks` the folder stays until this process ends: what is seen is read when it is shown.

    Raises:
        ModelError: they cannot be written.
    """
    wanted = [file for file in model.files if looks or file.collides]
    uris = {file.uri: f"package://{UNPACKED}/{quote(file.path)}" for file in wanted if file.uri}
    if not wanted:
        yield None, uris
    elif looks:
        yield Path(_kept(model).name), uris
    else:
        with _unpacked_into(wanted) as folder:
            yield Path(folder), uris


@cache  # One that is forgotten is deleted, and may still be shown.
def _kept(model: RobotModel) -> "tempfile.TemporaryDirectory[str]":
    return _unpacked_into(model.files)


def _unpacked_into(wanted: Sequence[ModelFile]) -> "tempfile.TemporaryDirectory[str]":
    """A new folder with files."""
    try:
        folder = tempfile.TemporaryDirectory(prefix="drake_gait-")
        for file in wanted:
            path = Path(folder.name) / file.path
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(file.content)
    except OSError as error:
        raise ModelError(
            f": cannot unpack its meshes into {tempfile.gettempdir()}: {error.strerror}; free "
            "space, or set TMPDIR"
        ) from None
    return folder


def _files(content: bytes, folder: Path, robot: RobotFile) -> tuple[ModelFile, ...]:
    """The files that a description names, and those that they need."""
    paths: dict[Path, tuple[str, bool]] = {}
    for uri, (place, collides) in named_files(content, robot).items():
        path = _resolved(uri, folder, place)
        paths[path] = (uri, collides)
        for other in _needed_by(path):
            paths.setdefault(other, ("", collides))
    if not paths:
        return ()
    root = os.path.commonpath([path.parent for path in paths])
    return tuple(
        ModelFile(
            path=os.path.relpath(path, root), content=path.read_bytes(), uri=uri, collides=collides
        )
        for path, (uri, collides) in paths.items()
    )


def _resolved(uri: str, folder: Path, place: str) -> Path:
    """The file that a URI means, beside the description or in a package."""
    scheme, rest = found.groups() if (found := _SCHEME.fullmatch(uri)) else ("", uri)
    cure = "give its path from the description's folder"
    if scheme.lower() in ("package", "model"):
        package, _, rest = unquote(rest).partition("/")
        root = _package(package, folder)
        if root is None:
            raise ModelError(
                f"{place} '{uri}' is in a package that is not found; add the folder of '{package}' "
                f"to ROS_PACKAGE_PATH, or {cure}"
            )
        path = root / rest
    elif scheme.lower() in ("", "file"):
        path = folder / (unquote(rest) if scheme else rest)
    else:
        raise ModelError(f"{place} '{uri}' is no file; {cure}")
    path = Path(os.path.normpath(path.absolute()))
    if not path.is_file():
        raise ModelError(f"{place} '{uri}': there is no file {path}; {cure}")
    if "mesh" in place and path.suffix.lower() not in _MESHES:
        raise ModelError(
            f"{place} '{uri}': Drake has no use for a {path.suffix or 'file without a suffix'}; "
            f"convert it to one of {', '.join(_MESHES)}"
        )
    if not os.access(path, os.R_OK):
        raise ModelError(f"{place} '{uri}': cannot read {path}; permit reading")
    return path


def _package(name: str, folder: Path) -> Path | None:
    """Folder of a package: on ROS_PACKAGE_PATH, ours, or one that the description lies in."""
    from pydrake.multibody.parsing import PackageMap

    for ancestor in (folder, *folder.parents):
        if ancestor.name == name:
            return ancestor
    packages = PackageMap()
    packages.AddPackageXml(models_folder() / "package.xml")
    packages.PopulateFromRosPackagePath()
    return Path(packages.GetPath(name)) if packages.Contains(name) else None


def _needed_by(path: Path) -> Iterator[Path]:
    """The files that a mesh needs beside itself: materials, textures, buffers."""
    for name in _mentioned(path.suffix.lower(), path.read_bytes()):
        other = Path(os.path.normpath(path.parent / unquote(name)))
        if other.is_file() and other != path:
            yield other
            if other.suffix.lower() == ".mtl":
                yield from _needed_by(other)


def _mentioned(kind: str, content: bytes) -> list[str]:
    """Names of the files that a file mentions."""
    if kind in (".obj", ".mtl"):
        lines = content.decode("utf-8", "replace").splitlines()
        words = (line.split() for line in lines)
        return [
            # The name ends its line, after any options.
            line[-1]
            for line in words
            if len(line) > 1 and (line[0] == "mtllib" or line[0].startswith(("map_", "bump")))
        ]
    if kind == ".gltf":
        try:
            found = json.loads(content)
            items = [*found.get("buffers", []), *found.get("images", [])]
            uris = [item.get("uri", "") for item in items]
        except (ValueError, AttributeError, TypeError):
            return []  # Drake says what is wrong with it.
        return [uri for uri in uris if uri and not uri.startswith("data:")]
    return []


def _sha256(content: bytes, others: tuple[ModelFile, ...], robot: RobotFile | None = None) -> str:
    digest = hashlib.sha256(content)
    if robot is not None and robot.identity != default_robot().identity:
        digest.update(f"\0{robot.identity}".encode())
    for file in others:
        digest.update(f"\0{file.uri}\0{Path(file.path).name}\0".encode())
        digest.update(hashlib.sha256(file.content).digest())
    return digest.hexdigest()


def _packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content)).decode()


@lru_cache(maxsize=32)
def _unpacked(text: str) -> bytes:
    return zlib.decompress(base64.b64decode(text, validate=True))
