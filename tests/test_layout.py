"""The package's own rules: who imports whom, what is exported, and that everything public is documented."""

import ast
import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import foreswitch as fsw

SOURCE = Path(fsw.__file__).parent
MODULES = sorted(path.stem for path in SOURCE.glob("*.py"))

# Data flows one way: a module may import from rows above its own, never from its own row or below.
ORDER = [
    {"plant"},
    {
        "prediction",
        "reference",
        "objective",
        "nonlinear",
        "plot",
        "estimator",
        "record",
        "structure",
        "response",
        "levels",
        "peak_gain",
        "covering",
        "study_draw",
    },
    {"hardware", "fitting", "horizon", "misprediction"},
    {"core", "estimate", "endpoint_design"},
    {"horizon_design"},
    {"controller", "run", "diagnosis", "record_plot"},
    {"loop", "fit", "error_loop"},
    {
        "batch",
        "baselines",
        "precision",
        "experiment",
        "identify",
        "ideal",
        "measurement_error",
        "design_header",
        "golden",
    },
    {"overload", "certificate_plot"},
    {"margins"},
    {"verdict"},
    {"certificate"},
    {"project", "export"},
    {"report", "draft", "study_plan", "fmu"},
    {"compare", "demo", "study_run", "study_plot"},
    {"study_store"},
    {"study"},
    {"page"},
    {"cli"},
]
#: The same within the page: what is computed, then the processes that do it, then the server.
PAGE = [
    {"limits", "wire", "schema", "frames"},
    {"complaint", "guard", "workers"},
    {"setups", "presets", "replay", "records"},
    {"answers", "exports"},
    {"jobs", "socket"},
    {"worker"},
    {"server"},
]
WEB = {"starlette", "uvicorn", "websockets"}
EXTENSIONS = {"_core_float32": "core", "_core_float64": "core", "_response": "response"}


def imported(module):
    """Siblings that a module imports, anywhere in it."""
    tree = ast.parse((SOURCE / f"{module}.py").read_text())
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("foreswitch.")}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "foreswitch":
            below = node.module.split(".")[1:]
            names |= {below[0]} if below else {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
    return names


def row(module):
    return next(i for i, modules in enumerate(ORDER) if module in modules)


def test_every_module_has_its_place():
    assert set().union(*ORDER) == {name for name in MODULES if not name.startswith("_")} | {"page"}
    assert set().union(*PAGE) == {path.stem for path in SOURCE.glob("page/*.py")} - {"__init__"}


def page_imports(module):
    """What a module of the page imports: of the page, of the package besides, and of other libraries."""
    nodes = list(ast.walk(ast.parse((SOURCE / "page" / f"{module}.py").read_text())))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"page.{module} imports relatively"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    below = [name.split(".")[1:] for name in names if name.startswith("foreswitch.")]
    own = {name[1] for name in below if name[0] == "page"}
    return own, {name[0] for name in below if name[0] != "page"}, {name.split(".")[0] for name in names}


@pytest.mark.parametrize("module", sorted(set().union(*PAGE)))
def test_the_page_imports_in_the_flow_of_data(module):
    """Only the server, its talk and its frames know of the web; the page knows nothing of the command line."""
    own, siblings, others = page_imports(module)
    at = next(i for i, modules in enumerate(PAGE) if module in modules)
    assert own <= set().union(*PAGE[:at])
    assert "cli" not in siblings
    assert not others & WEB or module in ("server", "socket", "frames")


def test_only_the_command_line_knows_the_page():
    assert [name for name in MODULES if "page" in imported(name)] == ["cli"]


@pytest.mark.parametrize("module", [name for name in MODULES if name != "__init__"])
def test_imports_follow_the_flow_of_data(module):
    """Helpers, whose names start with _, serve all and import only each other."""
    siblings = imported(module) - EXTENSIONS.keys()
    if module.startswith("_"):
        assert {name for name in siblings if not name.startswith("_")} == set()
    else:
        assert {name for name in siblings if not name.startswith("_") and row(name) >= row(module)} == set()


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_each_extension_module_has_one_module_that_touches_it(extension):
    assert [name for name in MODULES if extension in imported(name)] == [EXTENSIONS[extension]]


def test_importing_the_package_needs_no_extra():
    """Optional libraries are imported where they are used."""
    optional = {"control", "pandas", "pyarrow", "fmpy", "dask", "distributed"} | WEB
    for module in MODULES:
        top = ast.parse((SOURCE / f"{module}.py").read_text()).body
        names = {alias.name.split(".")[0] for node in top if isinstance(node, ast.Import) for alias in node.names}
        names |= {(node.module or "").split(".")[0] for node in top if isinstance(node, ast.ImportFrom)}
        assert not names & optional, module


# Names ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("module", MODULES)
def test_all_names_exist_and_stand_once(module):
    loaded = fsw if module == "__init__" else importlib.import_module(f"foreswitch.{module}")
    listed = loaded.__all__
    assert len(set(listed)) == len(listed)
    assert [name for name in listed if not hasattr(loaded, name)] == []


def test_the_contract_names_are_there():
    assert {"Plant", "Controller", "Endpoint", "Sine", "Ramp", "Steps", "HalfSine", "Samples", "Stack"} <= set(
        fsw.__all__
    )
    assert {"simulate", "Run", "Decision", "Status", "baselines"} <= set(fsw.__all__)
    assert {"simulate_batch", "Batch", "Hardware", "Stuck", "NonlinearPlant", "FmuPlant"} <= set(fsw.__all__)


# Documentation --------------------------------------------------------------------------------------------------------


def public_objects():
    """Every public class, function and method by dotted name."""
    found = {f"foreswitch.{name}": getattr(fsw, name) for name in fsw.__all__}
    found |= {f"foreswitch.baselines.{name}": getattr(fsw.baselines, name) for name in fsw.baselines.__all__}
    for name, item in list(found.items()):
        if inspect.isclass(item):
            for attribute, value in vars(item).items():
                plain = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
                if not attribute.startswith("_") and (inspect.isfunction(plain) or isinstance(plain, property)):
                    found[f"{name}.{attribute}"] = plain
    return {name: item for name, item in found.items() if not inspect.ismodule(item)}


PUBLIC = public_objects()


def parameters(item):
    """Names that a call takes; none for properties and enumerations."""
    if isinstance(item, property) or (inspect.isclass(item) and issubclass(item, (int, BaseException))):
        return []
    return [name for name in inspect.signature(item).parameters if name not in ("self", "cls")]


def documented(item):
    """Names in the Parameters or Attributes section; `a, b : type` names both."""
    lines = inspect.cleandoc(item.__doc__).splitlines()
    names = set()
    for i, line in enumerate(lines[:-1]):
        if line in ("Parameters", "Attributes") and re.fullmatch("-+", lines[i + 1]):
            for entry in lines[i + 2 :]:
                if entry and not entry.startswith(" "):
                    names |= {name.strip().lstrip("*") for name in entry.split(" : ")[0].split(",")}
                if re.fullmatch("-+", entry):
                    break
    return names


@pytest.mark.parametrize("name", PUBLIC)
def test_everything_public_is_documented_down_to_each_parameter(name):
    item = PUBLIC[name]
    assert item.__doc__, f"{name} has no docstring"
    assert not item.__doc__.startswith(f"{name.split('.')[-1]}("), f"{name} has only the docstring that dataclass makes"
    assert set(parameters(item)) - documented(item) == set()


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
    assert parameters(fsw.Controller)[:3] == ["plant", "levels", "Ts"]
    assert documented(fsw.Controller) >= {"min_on", "min_off", "bad_limit"}


@pytest.mark.parametrize("module", [name for name in MODULES if name not in ("__init__", "cli")])
def test_examples_in_docstrings_run(module):
    loaded = importlib.import_module(f"foreswitch.{module}")
    assert doctest.testmod(loaded).failed == 0


def test_there_are_examples_to_run():
    finder = doctest.DocTestFinder()
    counts = [len(test.examples) for module in (fsw.Plant, fsw.Controller) for test in finder.find(module)]
    assert sum(counts) >= 4
