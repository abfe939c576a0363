"""The package as a whole: public names, what importing costs, which folder may use which."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import trunnion as tn

PACKAGE = Path(tn.__file__).parent
MAX_FILE_LINES = 500
MAX_FUNCTION_LINES = 60
EXAMPLES = re.compile(
    r'\n\n +Examples\n +-+\n.*?(?=\n +""")', re.DOTALL
)  # of docstrings: not counted

# A folder uses only those above it in this list.
LAYERS = (
    "_core",
    "base",
    "files",
    "nc",
    "setup",
    "data",
    "machine",
    "probing",
    "hybrid",
    "contouring",
    "turning",
    "diagnosis",
    "models",
    "compensation",
    "controls",
    "reference",
    "studies",
    "plot",
    "reports",
    "samples",
    "datasets",
    "demo",
    "cli",
    "__main__",
)


def test_package_has_a_version() -> None:
    assert tn.__version__.count(".") == 2


@pytest.mark.parametrize("use", ["", "; [getattr(tn, name) for name in tn.__all__]"])
def test_importing_does_not_import_pyplot_or_statistics(use: str) -> None:
    heavy = "{'matplotlib.pyplot', 'scipy.stats', 'pandas', 'casadi', 'pinocchio'}"
    code = f"import sys, trunnion as tn{use}; print(sorted({heavy} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


MEASURED = (
    "setup = tn.read_setup(tn.sample_path('hidden/setup.toml')); "
    "touches = tn.read_touches(tn.sample_path('hidden/touches.csv')); "
)


@pytest.mark.parametrize(
    "use",
    [
        "tn.simulate(tn.plan(setup), setup)",
        "tn.identify(touches, setup)",
        "tn.diagnose(touches, setup).to_json()",
        "tn.volumetric_error(setup, {'EX0C': 1.0})",
    ],
)
def test_the_main_job_does_not_import_optimisers(use: str) -> None:
    """They take 0.1 s of CPU to load, several times a diagnosis."""
    heavy = "{'scipy.optimize', 'scipy.interpolate', 'scipy.sparse'}"
    code = f"import sys, trunnion as tn; {MEASURED}{use}; print(sorted({heavy} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_help_does_not_import_numbers() -> None:
    """``trunnion --help`` takes at most 0.3 s of CPU; numpy alone takes a third of that."""
    code = "import sys, trunnion.cli; print(sorted({'numpy', 'rich', 'scipy'} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_what_one_begins_with_is_public_and_short() -> None:
    assert set(dir(tn)) == set(tn.MAIN)
    assert set(tn.MAIN) <= set(vars(tn)["__all__"])
    assert len(tn.MAIN) <= 60


def _layer(module: str) -> int | None:
    """Layer of a dotted name of the package; None for the package itself and for other packages."""
    parts = module.split(".")
    return LAYERS.index(parts[1]) if parts[0] == "trunnion" and len(parts) > 1 else None


def _imports(tree: ast.Module) -> set[str]:
    """Every module that a file imports, at its top or in a function; not for type checkers only."""
    checked = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and ast.unparse(branch.test) == "TYPE_CHECKING"
        for node in ast.walk(branch)
    }
    found: set[str] = set()
    for node in ast.walk(tree):
        if id(node) in checked:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in found if name.split(".")[0] == "trunnion"}


def _files() -> list[Path]:
    return [path for path in sorted(PACKAGE.rglob("*.py")) if path != PACKAGE / "__init__.py"]


def _module(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_no_import_runs_upward() -> None:
    upward = []
    for path in _files():
        own = _layer(_module(path))
        assert own is not None, path
        for name in _imports(ast.parse(path.read_text())):
            if name == "trunnion" and own < LAYERS.index("cli"):  # commands use the public API
                upward.append(f"{path.relative_to(PACKAGE)}: the package itself")
            elif name != "trunnion" and (_layer(name) or 0) > own:
                upward.append(f"{path.relative_to(PACKAGE)}: {name}")
    assert not upward, "\n".join(upward)


def test_no_import_circle() -> None:
    modules = {_module(path): path for path in _files()}
    uses = {
        module: {name for name in _imports(ast.parse(path.read_text())) if name in modules}
        - {module}
        for module, path in modules.items()
    }
    # Packages import their own files; a file that names its package imports the package's names.
    left = {module: set(used) for module, used in uses.items()}
    while free := [module for module, used in left.items() if not used & set(left)]:
        for module in free:
            del left[module]
    assert not left, f"in circles: {', '.join(sorted(left))}"


def _code_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function without those of its docstring."""
    first = node.body[0]
    length = (node.end_lineno or 0) - node.lineno + 1
    is_text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return length - ((first.end_lineno or 0) - first.lineno + 1) if is_text else length


def test_files_and_functions_are_short() -> None:
    long = []
    for path in _files():
        text = path.read_text(encoding="utf-8")
        if len(EXAMPLES.sub("", text).splitlines()) > MAX_FILE_LINES:
            long.append(path.name)
        long += [
            f"{path.name}: {node.name}"
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            and _code_lines(node) > MAX_FUNCTION_LINES
        ]
    assert long == []
