"""The layers of the package and the walls around its libraries, as CONTRIBUTING.md draws them."""

import ast
import functools
import graphlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HOME = ROOT / "drake_gait"
PACKAGE = sorted(HOME.rglob("*.py"))
EVERYWHERE = [
    path for folder in ("drake_gait", "tests", "tools") for path in (ROOT / folder).rglob("*.py")
]

LAYERS = (
    ("optimize", "__main__"),
    ("cli",),
    ("sweep",),
    ("optimization",),
    ("report",),
    ("search", "hardware"),
    ("visualization", "study", "execution"),
    ("simulation", "surrogates"),
    ("problem", "optimizers"),
    ("robot",),
    ("walk",),
    ("gait",),
    ("foot", "servo", "sole"),
    ("arrays", "ranges", "files", "provenance"),
    ("errors",),
)
"""Folders and modules of the package, the highest first: imports go to lower layers only."""

ENTRANCE = {"__init__"}
"""The front door, which imports from every layer when a name is first used."""

WALLS = {
    "pydrake": {"robot", "simulation", "visualization", "cli"},
    "torch": {"surrogates"},
    "sklearn": {"surrogates"},
    "sqlite3": {"study"},
    "dask": {"execution"},
    "distributed": {"execution"},
    "matplotlib": {"visualization"},
    "cmaes": {"search"},
    "cloudpickle": {"gait", "problem"},
    "rich": {"cli"},
    "mujoco": {"simulation"},
    "rcb4": {"hardware"},
    "optuna": {"report"},
    "sqlalchemy": {"report"},
    "jinja2": {"report"},
    "tools": set(),
    "tests": set(),
}
"""Who may import a library; nobody else may."""


def layer_of(place: str) -> int:
    """The number of a place's layer, 0 at the top."""
    (found,) = (number for number, places in enumerate(LAYERS) if place in places)
    return found


def place(path: Path) -> str:
    """The folder of the package that a file is in, or the module that it is."""
    return path.relative_to(HOME).with_suffix("").parts[0]


def module(path: Path) -> str:
    """The name that a file is imported by."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@functools.cache
def imports(path: Path, *, typing: bool = True) -> set[str]:
    """Names of all modules that a file imports, with what is taken from them."""
    found = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING" and not typing:
            skipped |= {id(inner) for statement in node.body for inner in ast.walk(statement)}
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} imports relatively"
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


MODULES = {module(path): path for path in PACKAGE}


def imported_modules(path: Path) -> set[str]:
    """Modules of the package that a module imports when it is imported."""
    return imports(path, typing=False) & MODULES.keys() - {module(path)}


def test_the_walk_finds_what_python_imports(tmp_path):
    # The laws below would hold of a walk that finds nothing.
    path = tmp_path / "module.py"
    path.write_text("import a.b\nfrom c import d\ndef f():\n    import e\n")
    assert imports(path) == {"a.b", "c", "c.d", "e"}
    source = MODULES["drake_gait.simulation.command_source"]
    assert {"pydrake.systems.framework", "drake_gait.gait"} <= imports(source)
    assert "drake_gait.errors" in imported_modules(MODULES["drake_gait.foot"])


@pytest.mark.parametrize("path", PACKAGE, ids=module)
def test_imports_go_down_only(path):
    here = place(path)
    if here in ENTRANCE:
        return
    for name in imported_modules(path) - {"drake_gait"}:
        there = name.split(".")[1]
        assert there == here or layer_of(there) > layer_of(here), f"{module(path)} imports {name}"


def test_every_place_has_a_layer():
    places = {place(path) for path in PACKAGE} - ENTRANCE
    assert places == {name for layer in LAYERS for name in layer}


@pytest.mark.parametrize("library", WALLS)
def test_a_library_stays_behind_its_wall(library):
    users = {
        place(path)
        for path in PACKAGE
        if any(name.split(".")[0] == library for name in imports(path))
    }
    assert users <= WALLS[library]


def test_the_modules_import_each_other_in_no_circle():
    # A folder's __init__ hands on what its own modules hold.
    graph = {
        name: imported_modules(path) for name, path in MODULES.items() if path.name != "__init__.py"
    }
    order = list(graphlib.TopologicalSorter(graph).static_order())
    gait, loop, command = "gait.paper", "search.loop", "cli._optimize"
    places = [order.index(f"drake_gait.{name}") for name in (gait, loop, command)]
    assert places == sorted(places)


def test_the_search_does_not_know_what_simulates():
    reached, waiting = set(), ["drake_gait.search.loop"]
    while waiting:
        name = waiting.pop()
        reached.add(name)
        waiting += imported_modules(MODULES[name]) - reached
    assert any(name.startswith("drake_gait.problem.") for name in reached)
    assert not [name for name in reached if name.startswith("drake_gait.simulation.")]


def test_nobody_imports_all_of_drake():
    # It is slow, and shadows min, max and abs.
    forbidden = "pydrake" + ".all"
    assert [path.name for path in EVERYWHERE if forbidden in imports(path)] == []


def test_the_package_depends_on_declared_libraries_only():
    declared = {
        "cloudpickle",
        "cmaes",
        "jinja2",
        "matplotlib",
        "numpy",
        "pydrake",
        "rich",
        "scipy",
        "torch",
    }
    declared |= {"drake_gait", "sklearn", "threadpoolctl"}
    extras = {"dask", "distributed", "mujoco", "optuna", "rcb4", "sqlalchemy"}
    for path in PACKAGE:
        libraries = {name.split(".")[0] for name in imports(path)} - set(sys.stdlib_module_names)
        assert libraries <= declared | extras, path.name


@pytest.mark.parametrize("path", PACKAGE, ids=module)
def test_a_module_says_what_it_is_for(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
