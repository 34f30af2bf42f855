"""The walls between the modules, as CONTRIBUTING.md draws them."""

import ast
import graphlib
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = sorted((ROOT / "drake_gait").rglob("*.py"))
EVERYWHERE = [
    path for folder in ("drake_gait", "tests", "tools") for path in (ROOT / folder).rglob("*.py")
]

COMMANDS = {path.stem for path in PACKAGE if "__main__" in path.read_text(encoding="utf-8")}
"""Modules that are run as `python -m drake_gait.<name>`."""

DRAKE = {"robot", "shapes", "gait_system", "simulation", "observer"} | COMMANDS
DRAKE |= {"portraits", "recording", "scene", "live"}

# Who may import what; nobody else may.
WALLS = {
    "pydrake": DRAKE,
    "torch": {"surrogate"},
    "sklearn": {"surrogate_baselines"},
    "sqlite3": {"store"},
    "dask": {"cluster"},
    "distributed": {"cluster"},
    "matplotlib": {"figures", "walk_figures", "study_figures", "sweep_figures"},
    "cmaes": {"baselines", "trust_region"},
    "rich": {"progress"},
    "optuna": {"optuna_study"},
    "jinja2": {"report_page"},
    "tools": set(),
    "tests": set(),
}

MOST_LINES = 400


def imports(path, *, typing=True):
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


def imported_modules(path):
    """Modules of the package that a module imports when it is imported."""
    names = {name.split(".")[1] for name in imports(path, typing=False) if name.count(".")
             and name.startswith("drake_gait.")}  # fmt: skip
    return names & {module.stem for module in PACKAGE}


def test_the_walk_finds_what_python_imports(tmp_path):
    # The laws below would hold of a walk that finds nothing.
    path = tmp_path / "module.py"
    path.write_text("import a.b\nfrom c import d\ndef f():\n    import e\n")
    assert imports(path) == {"a.b", "c", "c.d", "e"}
    by_name = {module.stem: module for module in PACKAGE}
    assert {"pydrake.systems.framework", "drake_gait.gait"} <= imports(by_name["gait_system"])
    assert {"gait", "errors"} <= imported_modules(by_name["foot"]) | imported_modules(
        by_name["problem"]
    )
    assert {"optimize", "replay"} <= COMMANDS


@pytest.mark.parametrize("library", WALLS)
def test_a_library_stays_behind_its_wall(library):
    users = {
        path.stem
        for path in PACKAGE
        if any(name.split(".")[0] == library for name in imports(path))
    }
    assert users <= WALLS[library]


def test_the_modules_import_each_other_in_no_circle():
    graph = {path.stem: imported_modules(path) for path in PACKAGE}
    order = list(graphlib.TopologicalSorter(graph).static_order())
    assert order.index("gait") < order.index("search") < order.index("optimize")


def test_only_the_commands_are_above_the_commands():
    for path in PACKAGE:
        if path.stem not in COMMANDS:
            assert not imported_modules(path) & COMMANDS, path.name


def test_the_search_does_not_know_what_simulates():
    above = {"simulation", "robot", "gait_system", "observer", "portraits", "recording", "scene"}
    graph = {path.stem: imported_modules(path) for path in PACKAGE}
    reached, waiting = set(), ["search"]
    while waiting:
        module = waiting.pop()
        reached.add(module)
        waiting += graph[module] - reached
    assert "problem" in reached
    assert not reached & above


def test_nobody_imports_all_of_drake():
    # It is slow, and shadows min, max and abs.
    forbidden = "pydrake" + ".all"
    assert [path.name for path in EVERYWHERE if forbidden in imports(path)] == []


def test_the_package_depends_on_declared_libraries_only():
    declared = {"cmaes", "jinja2", "matplotlib", "numpy", "pydrake", "rich", "scipy", "torch"}
    declared |= {"drake_gait", "sklearn", "threadpoolctl"}
    extras = {"dask", "distributed", "optuna", "sqlalchemy"}
    for path in PACKAGE:
        libraries = {name.split(".")[0] for name in imports(path)} - set(sys.stdlib_module_names)
        assert libraries <= declared | extras, path.name


@pytest.mark.parametrize("path", PACKAGE, ids=lambda path: path.stem)
def test_a_module_is_short_enough_to_read(path):
    lines = len(path.read_text(encoding="utf-8").splitlines())
    assert lines <= MOST_LINES


@pytest.mark.parametrize("path", PACKAGE, ids=lambda path: path.stem)
def test_a_module_says_what_it_is_for(path):
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
