"""The elements of a robot description in SDFormat: read, looked up and changed.

Drake knows its own elements by the prefix `drake:` alone, declared or not.
"""

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers import expat

from drake_gait.errors import ModelError

SIDES = ("r", "l")
FOOT_LINKS = ("foot", "big_toe", "lesser_toes")
"""Links of a foot, without their side; the first is the heel part."""
TOES = FOOT_LINKS[1:]
TOE_HINGES = tuple(f"{toe}_hinge_{side}" for side in SIDES for toe in TOES)
"""The four passive joints, in the order of every array of toe values."""
BASE = "torso"
"""The link that floats, whose posture is that of the robot."""
ANKLES = tuple(f"ankle_{side}" for side in SIDES)
FEET = tuple(f"{link}_{side}" for side in SIDES for link in FOOT_LINKS)
LINKS = (BASE, *ANKLES, *FEET)
"""All links that a walk, its measures, its figures and its recording know by name."""

MU_STATIC, MU_DYNAMIC = "drake:mu_static", "drake:mu_dynamic"
PROXIMITY = "drake:proximity_properties"

_OTHER_FORMATS = {
    "robot": "a URDF; walks need SDFormat: `gz sdf -p robot.urdf > robot.sdf` writes it, and "
    "docs/explanation/robot.md says what must be in it",
    "mujoco": "an MJCF; walks need SDFormat: `mjcf2sdf robot.xml robot.sdf` (gz-mujoco) writes it, "
    "and docs/explanation/robot.md says what must be in it",
}


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
            raise ModelError(f" is not a well-formed SDF file: {error}") from None
        except (LookupError, ValueError) as error:
            raise ModelError(f": cannot decode it ({error}); save it as UTF-8") from None
        self.root = builder.close()

    def refusal(self, element: Element | None, text: str) -> ModelError:
        """An error that says where; its text begins where the name of the file ends."""
        line = self._lines.get(element) if element is not None else None
        return ModelError(f", line {line}: {text}" if line else f": {text}")

    def model(self) -> Element:
        """The one model in it.

        Raises:
            ModelError: it is another format, or has something else than one model.
        """
        if self.root.tag in _OTHER_FORMATS:
            raise ModelError(f" is {_OTHER_FORMATS[self.root.tag]}")
        if self.root.tag != "sdf":
            raise ModelError(f" is no SDFormat: it begins with <{self.root.tag}>, not <sdf>")
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


def with_friction(root: Element, factor: float, ground: float) -> None:
    """Give the contact of all shapes with the ground `factor` times its friction.

    It is read as Drake reads it: <drake:mu_static> and <drake:mu_dynamic>; one stands for both.
    Without them <mu> and <mu2> of <surface> count, else 1.

    Args:
        root: The description, which is changed.
        factor: On the friction of each pair of shape and ground.
        ground: Both coefficients of the ground; Drake combines two surfaces as 2ab / (a + b).

    Raises:
        ModelError: a friction cannot be multiplied by so much.
    """
    if factor == 1.0:
        return
    for collision in root.iter("collision"):
        properties = collision.find(PROXIMITY)
        found = [] if properties is None else _coefficients(properties)
        if not found:
            if properties is None:
                properties = ElementTree.SubElement(collision, PROXIMITY)
            for tag, value in zip((MU_STATIC, MU_DYNAMIC), frictions(collision), strict=True):
                element = ElementTree.SubElement(properties, tag)
                element.text = repr(value)
                found.append(element)
            for surface in collision.findall("surface"):
                collision.remove(surface)
        for element in found:
            element.text = repr(_surface(element, factor, ground))


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


def _surface(element: Element, factor: float, ground: float) -> float:
    """Coefficient of a surface whose contact with the ground has `factor` times its friction."""
    surface = float(element.text or "")
    contact = factor * 2.0 * surface * ground / (surface + ground)
    if not contact < 2.0 * ground:
        raise ModelError(
            f": no surface has {factor:g} times the friction of <{element.tag}> {surface:g} on the "
            "ground; lower walk.friction"
        )
    return contact * ground / (2.0 * ground - contact)


def remove_looks(root: Element) -> None:
    """Take what is only seen out of a description."""
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)


def with_files(root: Element, paths: Mapping[str, str]) -> None:
    """Let a description name its files by other URIs."""
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            for element, _ in uris(shape):
                element.text = paths[(element.text or "").strip()]


def uris(shape: Element) -> Iterator[tuple[Element, str]]:
    """Yield the elements of a shape that name a file, and what the file is, in words."""
    for mesh in shape.iter("mesh"):
        for uri in mesh.findall("uri"):
            yield uri, "mesh"
    for picture in shape.iter("drake:diffuse_map"):
        yield picture, "<drake:diffuse_map>"
