"""The elements of a robot description: read, looked up and changed.

Drake knows its own elements by the prefix `drake:` alone, declared or not.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from drake_gait.errors import ModelError

MU_STATIC, MU_DYNAMIC = "drake:mu_static", "drake:mu_dynamic"
PROXIMITY = "drake:proximity_properties"


class Format(StrEnum):
    """Format of a model; the value is what Drake's parser calls it."""

    SDF = "sdf"
    URDF = "urdf"
    MJCF = "xml"


_ROOTS = {"sdf": Format.SDF, "robot": Format.URDF, "mujoco": Format.MJCF}
"""How models begin."""
_MODEL = {
    "compiler", "default", "asset", "worldbody", "actuator", "contact", "equality", "tendon",
}  # fmt: skip
"""Parts of an MJCF that are the robot; others are of an engine or of a viewer."""


class Description:
    """The elements of a description, and the line of each."""

    def __init__(self, content: bytes) -> None:
        """Read a file's content.

        Raises:
            ModelError: it is no XML; the text begins where the name of the file ends.
        """
        builder = ElementTree.TreeBuilder()
        # Without namespaces: elements keep their prefix, which is what Drake goes by.
        parser = expat.ParserCreate()
        parser.buffer_text = True
        self._lines: dict[Element, int] = {}

        def start(tag: str, attributes: dict[str, str]) -> None:
            element = builder.start(tag, attributes)
            self._lines[element] = parser.CurrentLineNumber

        parser.StartElementHandler = start
        parser.EndElementHandler = builder.end
        parser.CharacterDataHandler = builder.data
        try:
            parser.Parse(content, True)
        except expat.ExpatError as error:
            raise ModelError(f" is not a well-formed XML file: {error}") from None
        except (LookupError, ValueError) as error:
            raise ModelError(f": cannot decode it ({error}); save it as UTF-8") from None
        self.root = builder.close()
        if self.root.tag not in _ROOTS:
            raise ModelError(
                f" is no model of a robot: it begins with <{self.root.tag}>, not with <sdf>, "
                "<robot> (URDF) or <mujoco> (MJCF)"
            )
        self.format = _ROOTS[self.root.tag]
        """The format of the model."""

    def refusal(self, element: Element | None, text: str) -> ModelError:
        """An error that says where; its text begins where the name of the file ends."""
        line = self._lines.get(element) if element is not None else None
        return ModelError(f", line {line}: {text}" if line else f": {text}")

    def model(self) -> Element:
        """The one model in it, an SDFormat.

        Raises:
            ModelError: it has something else than one model.
        """
        models = list(self.root.iter("model"))
        others = [child for child in self.root if child.tag != "model"]
        others += list(self.root.iter("include"))
        if others:
            raise self.refusal(
                others[0], f"<{others[0].tag}> is not read; write the robot as one <model>"
            )
        if len(models) != 1:
            raise self.refusal(
                models[1] if models else None,
                f"there must be one <model>, got {len(models)}; write the robot as one",
            )
        return models[0]

    def elements(self, kind: str) -> list[Element]:
        """The elements of all links ("link") or joints ("joint") of the robot."""
        if self.format is Format.URDF:  # In <transmission> there are other <joint>.
            return self.root.findall(kind)
        if self.format is Format.SDF:
            return self.model().findall(kind)
        tag = "body" if kind == "link" else kind
        return [one for world in self.root.findall("worldbody") for one in world.iter(tag)]

    def names(self, kind: str) -> list[str]:
        """The names of all links ("link") or joints ("joint") of the robot."""
        return [one.get("name") or "" for one in self.elements(kind)]

    def of_tag(self, parent: str, tag: str) -> Element | None:
        """The first element of a tag inside another one."""
        for element in self.root.iter(parent):
            if (found := element.find(tag)) is not None:
                return found
        return None


def find_link(root: Element, name: str) -> Element:
    """A link of a description.

    Raises:
        ModelError: there is none of this name.
    """
    for link in root.iter("link"):
        if link.get("name") == name:
            return link
    raise ModelError(f": no link '{name}'")


def frictions(collision: Element) -> tuple[float, float]:
    """Static and dynamic friction of a shape, as Drake reads them."""
    properties = collision.find(PROXIMITY)
    given = {} if properties is None else {one.tag: one for one in _coefficients(properties)}
    if given:
        static = given.get(MU_STATIC, given.get(MU_DYNAMIC))
        dynamic = given.get(MU_DYNAMIC, given.get(MU_STATIC))
    else:
        static, dynamic = (collision.find(f"surface/friction/ode/{tag}") for tag in ("mu", "mu2"))
    return tuple(1.0 if one is None else float(one.text or "") for one in (static, dynamic))  # type: ignore[return-value]


def _coefficients(properties: Element) -> list[Element]:
    """The coefficients among Drake's properties of a shape: those that count, the first ones."""
    found = (properties.find(tag) for tag in (MU_STATIC, MU_DYNAMIC))
    return [element for element in found if element is not None]


def remove_looks(root: Element) -> None:
    """Take what is only seen out of a description; of an MJCF, Drake does it."""
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)


def remove_scenery(root: Element) -> None:
    """Take out of an MJCF what is no robot: its floor, lights, cameras, sensors and options.

    Drake would warn of some, and the floor would be part of the ground.
    """
    if root.tag != "mujoco":
        return
    for part in list(root):
        if part.tag not in _MODEL:
            root.remove(part)
    for world in root.findall("worldbody"):
        for item in list(world):
            if item.tag != "body":
                world.remove(item)
    for body in root.iter("body"):
        for item in list(body):
            if item.tag in ("site", "camera", "light"):
                body.remove(item)


def without_springs(root: Element) -> None:
    """Take the springs of all joints out of a description."""
    for joint in root.iter("joint"):
        joint.attrib.pop("stiffness", None)
        for dynamics in joint.iter("dynamics"):
            for tag in ("spring_stiffness", "spring_reference"):
                for spring in dynamics.findall(tag):
                    dynamics.remove(spring)


def with_files(root: Element, paths: Mapping[str, str]) -> None:
    """Let a description name its files by other URIs."""
    for name in uris(root):
        name.set(paths[name.uri])
    if root.tag == "mujoco":
        for compiler in root.iter("compiler"):
            for key in ("meshdir", "texturedir", "assetdir", "strippath"):
                compiler.attrib.pop(key, None)


@dataclass(frozen=True, kw_only=True)
class NamedFile:
    """A place in a description that names a file."""

    element: Element
    """The element."""
    attribute: str
    """Its attribute; empty: the name is the element's text."""
    what: str
    """What the file is, in words."""
    collides: bool
    """Whether a shape that touches needs it."""
    folder: str = ""
    """Folder that the name begins in, from the description's."""

    @property
    def uri(self) -> str:
        """Return the name of the file."""
        text = self.element.get(self.attribute) if self.attribute else self.element.text
        return f"{self.folder}{(text or '').strip()}"

    def set(self, uri: str) -> None:
        """Name another file."""
        if self.attribute:
            self.element.set(self.attribute, uri)
        else:
            self.element.text = uri


def uris(root: Element) -> list[NamedFile]:
    """Return the places in a description that name a file; those of shapes that touch come last."""
    if root.tag == "mujoco":
        return _uris_of_mjcf(root)
    found = []
    for kind in ("visual", "collision"):
        for shape in root.iter(kind):
            touches = kind == "collision"
            for mesh in shape.iter("mesh"):
                if root.tag == "robot":
                    found.append(NamedFile(element=mesh, attribute="filename", what="mesh",
                                           collides=touches))  # fmt: skip
                found += [
                    NamedFile(element=uri, attribute="", what="mesh", collides=touches)
                    for uri in mesh.findall("uri")
                ]
            found += [
                NamedFile(element=picture, attribute="", what="<drake:diffuse_map>",
                          collides=touches)
                for picture in shape.iter("drake:diffuse_map")
            ]  # fmt: skip
    return found


def _uris_of_mjcf(root: Element) -> list[NamedFile]:
    folders: dict[str, str] = {}
    for compiler in root.iter("compiler"):
        for key in ("assetdir", "meshdir", "texturedir"):
            if compiler.get(key):
                folders[key] = f"{compiler.get(key)}/".replace("//", "/")
    found = []
    for asset in root.findall("asset"):
        for item in asset:
            if item.get("file"):
                key = "meshdir" if item.tag == "mesh" else "texturedir"
                folder = folders.get(key, folders.get("assetdir", ""))
                what = item.tag if item.tag == "mesh" else f"<{item.tag}>"
                # A mesh may touch wherever a geom names it.
                found.append(NamedFile(element=item, attribute="file", what=what,
                                       collides=item.tag == "mesh", folder=folder))  # fmt: skip
    return found
