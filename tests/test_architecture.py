"""The architecture: rooms import earlier rooms only, the library knows nothing of its command line,
and heavy imports wait.
"""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import calibtool

PACKAGE = Path(calibtool.__file__).resolve().parent

# Data flows from left to right; a room is a folder or a single module. `tables` comes before
# `measurement`, whose import of instrument files reads them.
ROOMS = (
    "errors",
    "units",
    "progress",
    "processes",
    "unfinished_files",
    "atomic_output",
    "robot",
    "errormodel",
    "tables",
    "joint_and_pose_columns",
    "measurement",
    "identification",
    "planning",
    "equivalent",
    "calibration",
    "compensation",
    "controller",
    "programs",
    "export",
    "evaluation",
    "storage",
    "summary",
    "demo",
    "cli",
)


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@cache
def modules() -> tuple[tuple[Path, ast.Module], ...]:
    """Every module of the package but the two that only start it, with its syntax tree."""
    paths = [
        p
        for p in sorted(PACKAGE.rglob("*.py"))
        if room(p) not in ("__init__", "__main__", "_shipped")
    ]
    return tuple((path, ast.parse(path.read_text(encoding="utf-8"))) for path in paths)


def imported(tree: ast.Module, path: Path) -> set[str]:
    """Full names of the modules that a module imports anywhere, inside functions too."""
    names: set[str] = set()
    package = ("calibtool", *path.relative_to(PACKAGE).parts[:-1])
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            start = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (start, node.module or "") if part)
            names.add(module)
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return names


def tops(tree: ast.Module, path: Path) -> set[str]:
    return {name.split(".")[0] for name in imported(tree, path)}


LIBRARY = [(path, tree) for path, tree in modules() if room(path) != "cli"]


def test_every_room_is_in_the_order_and_the_order_names_no_other() -> None:
    assert {room(path) for path, _ in modules()} == set(ROOMS)


@pytest.mark.parametrize("name", ROOMS)
def test_a_room_imports_only_itself_and_earlier_rooms(name: str) -> None:
    allowed = set(ROOMS[: ROOMS.index(name) + 1])
    for path, tree in modules():
        if room(path) != name:
            continue
        for module in imported(tree, path):
            parts = module.split(".")
            if parts[0] == "calibtool" and len(parts) > 1 and parts[1] != "__version__":
                assert parts[1] in allowed, (
                    f"{path.name} imports calibtool.{parts[1]}, a later room"
                )


def test_the_order_is_needed() -> None:
    """Each room but the first is imported by none before it, and all but the command line
    by some after it.
    """
    used = {name: set() for name in ROOMS}
    for path, tree in modules():
        for module in imported(tree, path):
            parts = module.split(".")
            if (
                parts[0] == "calibtool"
                and len(parts) > 1
                and parts[1] in used
                and parts[1] != room(path)
            ):
                used[parts[1]].add(room(path))
    assert all(used[name] for name in ROOMS if name != "cli"), used
    assert not used["cli"]


@pytest.mark.parametrize(
    ("path", "tree"), LIBRARY, ids=lambda x: x.stem if isinstance(x, Path) else ""
)
def test_the_library_does_not_know_that_it_has_a_command_line(path: Path, tree: ast.Module) -> None:
    assert not {"typer", "click", "rich", "argparse"} & tops(tree, path)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("print", "input", "exit", "quit"), f"{path}:{node.lineno}"
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in ("sys", "os")
        ):
            assert node.attr not in ("exit", "_exit", "stdout", "stderr", "stdin", "argv"), (
                f"{path}:{node.lineno}"
            )
        if isinstance(node, ast.Raise) and node.exc is not None:
            assert "SystemExit" not in ast.dump(node.exc), f"{path}:{node.lineno}"


def test_only_storage_imports_h5py() -> None:
    assert {room(path) for path, tree in modules() if "h5py" in tops(tree, path)} == {"storage"}


def test_nothing_outside_its_module_names_a_language() -> None:
    """But for the help of the command line, which lists what there is."""
    from calibtool.programs import formats

    for name in formats.PROGRAM_FORMATS:
        for path, tree in modules():
            texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
            if name in texts and room(path) != "cli":
                assert f'NAME = "{name}"' in path.read_text(encoding="utf-8"), path


def test_only_plots_imports_matplotlib() -> None:
    assert {path.parent.name for path, tree in modules() if "matplotlib" in tops(tree, path)} == {
        "plots"
    }


def test_nothing_imports_scipy_stats() -> None:
    """It takes as long to import as everything else together; scipy.special has what is needed."""
    for path, tree in modules():
        assert not {name for name in imported(tree, path) if name.startswith("scipy.stats")}, path


def test_nothing_is_pickled_and_only_verbose_messages_ask_the_clock() -> None:
    for path, tree in modules():
        clock = set() if path.stem == "verbosity" else {"time", "datetime"}
        assert not ({"pickle", "shelve", "marshal"} | clock) & tops(tree, path), path


def test_randomness_is_an_argument() -> None:
    """Generators are made from seeds or passed in; numpy's global one and the standard
    library's are not used.
    """
    for path, tree in modules():
        assert "random" not in tops(tree, path), path
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                called = ast.unparse(node.func)
                if called == "np.random.default_rng":
                    assert node.args, f"{path}:{node.lineno}: a generator without a seed"
                elif re.fullmatch(r"np\.random\.\w+", called):
                    assert called == "np.random.SeedSequence", f"{path}:{node.lineno}: {called}"


def test_every_module_and_public_name_of_the_library_states_what_it_is() -> None:
    for path, tree in LIBRARY:
        assert ast.get_docstring(tree) or not tree.body, f"{path} has no docstring"
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{path}:{node.lineno}: {node.name}"


def test_no_two_modules_of_the_library_share_a_name() -> None:
    names = [path.stem for path, _ in LIBRARY if path.stem != "__init__"]
    assert sorted(names) == sorted(set(names))


@pytest.mark.parametrize("module", ["calibtool", "calibtool.cli", "calibtool.errors"])
def test_heavy_libraries_wait_until_they_are_needed(module: str) -> None:
    heavy = ("numpy", "scipy", "pinocchio", "matplotlib", "h5py", "pydantic", "jinja2")
    code = f"import sys, {module}; print([name for name in {heavy!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_compensation_starts_without_scipy() -> None:
    """Importing it takes longer than correcting 10,000 rows: the functions
    that need it import it.
    """
    code = (
        "import sys, calibtool.storage, calibtool.compensation.stream; print('scipy' "
        "in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
