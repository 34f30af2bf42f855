"""Drake's messages, heard instead of printed, in words for the user."""

import logging
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from pydrake.systems.framework import Context, Diagram

from drake_gait.robot.description import RobotModel
from drake_gait.robot.sdf_checks import checked

_IRRELEVANT = ("deformable contact",)
"""Drake warns that deformable bodies will not touch the ground; there are none."""

_PLACE = re.compile(r"^(<[a-z]+-string>[^:]*(:\d+)?: )?(error: |warning: )?")
_FOLDER = re.compile(r"/\S*/?drake_gait-\w+/")

_IGNORED = (
    re.compile(
        r"(?:Ignoring unsupported|Unsupported) SDFormat element in (?P<in>[\w:]+): (?P<tag>\S+)"
    ),
    re.compile(r"XML Element\[(?P<tag>\S+)\], child of element\[(?P<in>\S+)\], not defined in SDF"),
)
"""How Drake and its parser speak of an element that is not theirs."""


@contextmanager
def drake_messages() -> Iterator[list[str]]:
    """Inside, what Drake would print in this thread is collected instead."""
    thread, messages = threading.get_ident(), list[str]()

    def collect(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        if any(words in text for words in _IRRELEVANT):  # Drake may say it in a thread of its own.
            return False
        if record.thread != thread or record.levelno < logging.WARNING:
            return True
        messages.append(text.strip().splitlines()[0])
        return False

    log = logging.getLogger("drake")
    log.addFilter(collect)
    try:
        yield messages
    finally:
        log.removeFilter(collect)


def default_context(diagram: Diagram) -> Context:
    """Return the default context of a diagram, without what Drake says of deformable bodies."""
    with drake_messages():
        return diagram.CreateDefaultContext()


def without_folders(text: str) -> str:
    """A message without the folders into which meshes are unpacked, of which no user knows."""
    return _FOLDER.sub("", text).rstrip(". ")


def in_one_line(model: RobotModel, text: str) -> str:
    """Return Drake's complaint about a description; it begins where the file's name ends."""
    first = _PLACE.sub("", text.strip().splitlines()[0])
    for pattern in _IGNORED:
        if ignored := pattern.search(first):
            parent, tag = ignored["in"], ignored["tag"]
            description = checked(model.content, model.robot)
            element = description.of_tag(parent, tag)
            return str(
                description.refusal(element, f"Drake ignores <{tag}> in <{parent}>; remove it")
            )
    return f" is not a robot that can be used: {without_folders(first)}; mend the file"
