"""The package's own rules: what it loads, what is exported, and that everything public is documented."""

import ast
import doctest
import importlib
import inspect
import re
import subprocess
import sys
from enum import IntEnum
from pathlib import Path

import pytest
from numpydoc.docscrape import get_doc_object
from numpydoc.validate import Validator, validate

import foreswitch as fsw
from places import DOCS, ROOT, TESTS

SOURCE = Path(fsw.__file__).parent
MODULES = sorted(
    ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts).removesuffix(".__init__")
    for path in SOURCE.rglob("*.py")
)
#: Not of a light door: what plots, checks, prints, fits and tabulates.
HEAVY = {"matplotlib", "pydantic", "jinja2", "rich", "pandas", "scipy.stats", "scipy.signal", "scipy.optimize"}
OPTIONAL = {"control", "pandas", "pyarrow", "fmpy", "dask", "distributed", "starlette", "uvicorn", "websockets"}


# Walls ----------------------------------------------------------------------------------------------------------------


def wing(path):
    """The wing that a file stands in, or its own name."""
    return path.relative_to(SOURCE).parts[0]


def private(name):
    return name.startswith("_") and not name.startswith("__")


def defined(tree):
    """Underscore names that a module makes: functions, attributes of self, fields, constants."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def used(tree):
    """Underscore names that a module reaches for in something that is not itself."""
    for node in ast.walk(tree):
        own = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
        if isinstance(node, ast.Attribute) and not own:
            yield node.attr, node.lineno
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("foreswitch."):
            yield from ((alias.name, node.lineno) for alias in node.names)


def reaching(files):
    """Uses of a name beginning with an underscore outside the wing that makes it."""
    made = {}
    for path, tree in files.items():
        made.setdefault(wing(path), set()).update(filter(private, defined(tree)))
    for path, tree in files.items():
        for name, line in used(tree):
            if private(name) and name not in made[wing(path)]:
                yield f"{path.relative_to(SOURCE)}:{line} {name}"


def test_no_wing_reaches_into_another():
    files = {path: ast.parse(path.read_text()) for path in SOURCE.rglob("*.py")}
    others = {"_core_float32", "_core_float64", "_response", "_exit"}  # modules of C, os._exit
    assert [use for use in reaching(files) if use.split()[-1] not in others] == []


def test_a_reach_into_another_wing_is_found():
    files = {
        SOURCE / "model/plant.py": ast.parse("class Plant:\n    def _row(self): ...\n"),
        SOURCE / "control/law.py": ast.parse("from foreswitch.model.plant import _x\nplant._row()\nself._own = 1"),
    }
    assert list(reaching(files)) == ["control/law.py:1 _x", "control/law.py:2 _row"]


# Doors ----------------------------------------------------------------------------------------------------------------


def loaded_by(statement):
    """Modules that a statement loads in a process of its own."""
    command = [sys.executable, "-X", "importtime", "-c", statement]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    return {line.rpartition("|")[2].strip() for line in told.splitlines()}


def within(modules, libraries):
    return {name for name in modules if any(f"{name}.".startswith(f"{library}.") for library in libraries)}


def test_the_door_is_light():
    assert within(loaded_by("import foreswitch"), HEAVY | OPTIONAL) == set()


def test_a_controller_and_its_loop_need_no_heavy_library():
    """Endpoint and horizon, with a filter, in closed loop: still without pictures, fits and statistics."""
    run = """
import foreswitch as fsw
valve = fsw.Plant.integrator_lag(k=16500.0, c=0.006, L=0.005)
for objective in (fsw.Endpoint(Td=0.02, lam=2500.0), fsw.Horizon(4)):
    law = fsw.Controller(valve, [0, 1], 1e-3, objective, estimator=fsw.Kalman(1.0, 1.0))
    fsw.simulate(law, fsw.HalfSine(height=100.0, duration=0.1), 0.1)
"""
    assert within(loaded_by(run), HEAVY | OPTIONAL) == set()


def test_the_search_for_heavy_libraries_finds_them():
    assert within(loaded_by("import foreswitch; foreswitch.identify"), HEAVY) >= {"scipy.stats", "scipy.optimize"}


def test_optional_libraries_are_imported_where_they_are_used():
    """But the page's server, which is of one of them."""
    for path in SOURCE.rglob("*.py"):
        if path.parent.name == "page":
            continue
        top = ast.parse(path.read_text()).body
        names = {alias.name.split(".")[0] for node in top if isinstance(node, ast.Import) for alias in node.names}
        names |= {(node.module or "").split(".")[0] for node in top if isinstance(node, ast.ImportFrom)}
        assert not names & OPTIONAL, path


# Names ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("module", MODULES)
def test_all_names_exist_and_stand_once(module):
    loaded = importlib.import_module(module)
    listed = getattr(loaded, "__all__", [])
    assert listed or loaded.__file__.endswith("__init__.py")
    assert len(set(listed)) == len(listed)
    assert [name for name in listed if not hasattr(loaded, name)] == []


def test_no_wing_or_module_bears_the_name_of_a_public_function():
    """Else ``import foreswitch.wing.module as m`` could give a function."""
    functions = {name for name in fsw.__all__ if inspect.isfunction(getattr(fsw, name))}
    assert len(functions) >= 9
    assert {name for module in MODULES for name in module.split(".")} & functions == set()


def test_each_wing_says_what_it_answers():
    for path in SOURCE.glob("*/__init__.py"):
        text = ast.get_docstring(ast.parse(path.read_text()))
        assert text, path
        if not path.parent.name.startswith("_") and path.parent.name not in ("demo", "cli", "page"):
            assert {"In:", "Out:", "Rooms"} <= set(re.findall(r"In:|Out:|Rooms", text)), path


def test_the_stub_is_the_one_list_of_public_names():
    """What type checkers see is what is loaded."""
    stub = ast.parse(Path(fsw.__file__).with_suffix(".pyi").read_text())
    names = [alias for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names]
    assert all(alias.asname == alias.name for alias in names)
    assert sorted(alias.name for alias in names) == sorted(fsw.__all__)


def test_an_old_name_still_serves_and_says_the_new_one():
    with pytest.warns(DeprecationWarning, match="foreswitch.Candidate is now called FittedStructure"):
        assert fsw.Candidate is fsw.FittedStructure
    with pytest.raises(AttributeError):
        fsw.Candidates  # noqa: B018


def test_the_contract_names_are_there():
    assert {"Plant", "Controller", "Endpoint", "Sine", "Ramp", "Steps", "HalfSine", "Samples", "Stack"} <= set(
        fsw.__all__
    )
    assert {"simulate", "Run", "Decision", "Status", "baselines"} <= set(fsw.__all__)
    assert {"simulate_batch", "Batch", "Hardware", "Stuck", "NonlinearPlant", "FmuPlant"} <= set(fsw.__all__)


# Sizes ----------------------------------------------------------------------------------------------------------------

#: Lines of a module, and of a function below its docstring: what is read at one sitting.
MODULE_LINES, FUNCTION_LINES = 450, 60


def oversized(text):
    """What of a module is too long, and by how much."""
    lines = len(text.splitlines())
    found = [f"the module has {lines} lines"] if lines > MODULE_LINES else []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            body = node.body[1:] if ast.get_docstring(node, clean=False) is not None else node.body
            length = node.end_lineno - body[0].lineno + 1 if body else 0
            if length > FUNCTION_LINES:
                found.append(f"{node.name} has {length} lines")
    return found


def test_modules_and_functions_are_short_enough_to_read():
    """Tests, benchmarks and what makes the pages are read as often as the package."""
    made = (DOCS / "_build", DOCS / "_generated")
    paths = [path for folder in (ROOT / "src", TESTS, ROOT / "benchmarks", DOCS) for path in folder.rglob("*.py")]
    found = {path: oversized(path.read_text()) for path in paths if not set(made) & set(path.parents)}
    assert len(found) > 200
    assert {path: why for path, why in found.items() if why} == {}


def test_the_measure_of_sizes_sees_what_is_too_long():
    body = "\n".join("    x = 1" for _ in range(FUNCTION_LINES + 1))
    assert oversized(f'def f():\n    """Says what."""\n{body}\n') == [f"f has {FUNCTION_LINES + 1} lines"]
    assert oversized(f"class A:\n  def f(self):\n{body}\n") == [f"f has {FUNCTION_LINES + 1} lines"]
    assert oversized("x = 1\n" * (MODULE_LINES + 1)) == [f"the module has {MODULE_LINES + 1} lines"]


# Documentation --------------------------------------------------------------------------------------------------------


def public_objects():
    """Every public class, function and method by dotted name."""
    found = {f"foreswitch.{name}": getattr(fsw, name) for name in fsw.__all__}
    found |= {f"foreswitch.baselines.{name}": getattr(fsw.baselines, name) for name in fsw.baselines.__all__}
    for name, item in list(found.items()):
        if inspect.isclass(item):
            inherited = [base for base in reversed(item.__mro__) if base.__module__.startswith("foreswitch.")]
            for attribute, value in {name: value for base in inherited for name, value in vars(base).items()}.items():
                plain = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
                if not attribute.startswith("_") and (inspect.isfunction(plain) or isinstance(plain, property)):
                    found[f"{name}.{attribute}"] = plain
    return {name: item for name, item in found.items() if not inspect.ismodule(item)}


PUBLIC = public_objects()


#: Told by numpydoc and not asked for: sections that would only repeat others, types and descriptions where a name with its
#: unit says all, an order that keeps what goes together together, and a mood that is not ours.
NOT_ASKED = {"SA01", "EX01", "ES01", "RT03", "PR03", "PR04", "PR07", "PR08", "SS05"}


def complaints(name):
    """What numpydoc says of a docstring; fields of a dataclass may stand among its attributes."""
    found = [(code, words) for code, words in validate(name)["errors"] if code not in NOT_ASKED]
    item = PUBLIC[name]
    if not inspect.isclass(item):
        return found
    attributes = {each.strip() for entry in get_doc_object(item)["Attributes"] for each in entry.name.split(",")}
    missing = set(inspect.signature(item).parameters) - attributes if not issubclass(item, IntEnum) else set()
    named = Validator(get_doc_object(item)).doc_parameters
    return [(code, words) for code, words in found if code != "PR01" or missing - set(named)]


@pytest.mark.parametrize("name", PUBLIC)
def test_everything_public_is_documented_down_to_each_parameter(name):
    item = PUBLIC[name]
    assert item.__doc__, f"{name} has no docstring"
    assert not item.__doc__.startswith(f"{name.split('.')[-1]}("), f"{name} has only the docstring that dataclass makes"
    assert complaints(name) == []


def test_the_search_for_public_objects_finds_them():
    """The meta-test above would pass on an empty list."""
    assert {
        "foreswitch.Plant",
        "foreswitch.Plant.from_tf",
        "foreswitch.Controller.reset",
        "foreswitch.Run.metrics",
        "foreswitch.Samples.read_csv",
        "foreswitch.simulate",
        "foreswitch.baselines.tune",
    } <= set(PUBLIC)


def test_a_parameter_without_a_word_is_found(monkeypatch):
    monkeypatch.setattr(
        fsw.simulate, "__doc__", fsw.simulate.__doc__.replace("    seed : int, optional", "    seeds : int")
    )
    assert {code for code, _ in complaints("foreswitch.simulate")} == {"PR01", "PR02"}


@pytest.mark.parametrize("module", [name for name in MODULES if ".cli" not in name])
def test_examples_in_docstrings_run(module):
    loaded = importlib.import_module(module)
    assert doctest.testmod(loaded).failed == 0


def test_there_are_examples_to_run():
    finder = doctest.DocTestFinder()
    counts = [len(test.examples) for module in (fsw.Plant, fsw.Controller) for test in finder.find(module)]
    assert sum(counts) >= 4


# Mistakes -------------------------------------------------------------------------------------------------------------


def trees():
    return {path.relative_to(SOURCE).as_posix(): ast.parse(path.read_text()) for path in SOURCE.rglob("*.py")}


def named(node):
    return getattr(node, "id", getattr(node, "attr", None))


def bare_raises(tree):
    """Lines that raise a ValueError without an argument, a value and a remedy as its fields."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and node.exc is not None:
            raised = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            if named(raised) == "ValueError":
                yield node.lineno


def readings(tree):
    """Lines that take the text of a caught error apart: a method of it, a search in it, a pattern on it."""
    for handler in ast.walk(tree):
        if not isinstance(handler, ast.ExceptHandler) or handler.name is None:
            continue

        def is_text(node, error=handler.name):
            return isinstance(node, ast.Call) and named(node.func) == "str" and named(node.args[0]) == error

        for node in ast.walk(handler):
            inside = [node.value] if isinstance(node, (ast.Attribute, ast.Subscript)) else []
            inside += node.comparators if isinstance(node, ast.Compare) else []
            if isinstance(node, ast.Call) and named(getattr(node.func, "value", None)) == "re":
                inside += node.args
            if any(map(is_text, inside)):
                yield node.lineno


def test_every_mistake_of_a_users_is_raised_with_its_fields():
    assert {name: lines for name, tree in trees().items() if (lines := list(bare_raises(tree)))} == {}


def test_no_sentence_of_an_error_is_read():
    assert {name: lines for name, tree in trees().items() if (lines := list(readings(tree)))} == {}


@pytest.mark.parametrize(
    "line",
    ["str(error).replace('a', 'b')", "';' in str(error)", "re.match('x', str(error))", "str(error)[:3]",
     "str(error) == 'x' or str(error).startswith('y')", "raise ValueError(f'{error}')", "raise ValueError"],
)  # fmt: skip
def test_the_search_for_bare_raises_and_readings_finds_them(line):
    tree = ast.parse(f"try:\n    pass\nexcept ValueError as error:\n    {line}\n")
    assert [*bare_raises(tree), *readings(tree)]
