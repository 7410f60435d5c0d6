"""What the package promises to scripts: names that come when they are asked for, and docstrings
that state shapes.
"""

import ast
import dataclasses
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import calibtool

# `(N, n)`, `(…, 4, 4)`, `(k,)`; a docstring that refers to another one for its arguments says so.
_SHAPE = re.compile(r"\([\w…+·* ×−-]+,.*\)|[Aa]rguments as in|[Ss]hapes as in")


def test_every_name_is_there() -> None:
    for name in calibtool.__all__:
        assert getattr(calibtool, name) is not None, name
    assert set(calibtool.__all__) <= set(dir(calibtool))
    with pytest.raises(AttributeError, match="no attribute 'calibrate'"):
        calibtool.calibrate  # noqa: B018


def test_editors_and_type_checkers_see_the_same_names() -> None:
    stub = Path(calibtool.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    found = {
        alias.asname: f"{node.module}"
        for node in ast.walk(ast.parse(stub))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert {*found, "__version__"} == set(calibtool.__all__)
    for name, module in found.items():
        assert getattr(importlib.import_module(module), name) is getattr(calibtool, name)
    assert Path(calibtool.__file__).with_name("py.typed").exists()


def test_a_name_is_that_of_its_module() -> None:
    assert calibtool.simulate.__module__ == "calibtool.measurement.simulate"
    assert calibtool.train.__module__ == "calibtool.calibration.fit"


def test_names_are_imported_only_when_asked_for() -> None:
    code = (
        "import sys, calibtool as ct; print('numpy' in sys.modules); ct.CalibtoolError; "
        "print('numpy' in sys.modules); ct.load_robot; print('numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False", "True"]


def functions() -> Iterator[tuple[str, Any]]:
    """Every public function, and every public method and property of a public
    class, of the library.
    """
    for module in pkgutil.walk_packages(calibtool.__path__, "calibtool."):
        if module.name.startswith(("calibtool.cli", "calibtool.__main__")):
            continue
        loaded = importlib.import_module(module.name)
        for name, value in vars(loaded).items():
            if name.startswith("_") or getattr(value, "__module__", None) != module.name:
                continue
            if inspect.isfunction(value):
                yield f"{module.name}.{name}", value
            elif inspect.isclass(value):
                for part, member in vars(value).items():
                    function = getattr(member, "fget", None) or getattr(member, "func", None)
                    function = function or getattr(member, "__func__", member)
                    if not part.startswith("_") and inspect.isfunction(function):
                        yield f"{module.name}.{name}.{part}", function


FUNCTIONS = dict(functions())


def documented(name: str) -> str:
    """The docstring, or for an answer to a protocol the protocol's."""
    from calibtool.programs.configurations import Configuration

    text = inspect.getdoc(FUNCTIONS[name])
    place, _, part = name.rpartition(".")
    if text is None and name.startswith("calibtool.programs.configurations."):
        text = inspect.getdoc(getattr(Configuration, part))
    module, _, owner = place.rpartition(".")
    if text is None and module in sys.modules:
        bases = getattr(sys.modules[module], owner).__mro__
        text = next((doc for base in bases if (doc := inspect.getdoc(vars(base).get(part)))), None)
    return text or ""


def test_fields_of_public_classes_are_explained() -> None:
    """Every field but the robot stands in the docstring."""
    missing = []
    for name in calibtool.__all__:
        value = getattr(calibtool, name)
        if dataclasses.is_dataclass(value):
            text = inspect.getdoc(value) or ""
            missing += [
                f"{name}.{f.name}"
                for f in dataclasses.fields(value)
                if not re.search(rf"\b{f.name}\b", text)
            ]
    assert missing == []


def test_arrays_have_shapes() -> None:
    """A function whose signature has arrays states a shape, in its docstring or its class's."""
    missing = []
    for name, function in FUNCTIONS.items():
        arrays = re.search(r"\b(ND)?[aA]rray\b|ndarray", str(inspect.signature(function)))
        if arrays and not _SHAPE.search(documented(name)):
            missing.append(name)
    # General functions take any shape; families are lists of indices; the protocol states the shape
    # of q for its answers. What a family of errors says of its elements has the shape of its value.
    general = (
        "se3.readonly",
        "Parameters.groups",
        "Part.free",
        "robust.find_flagged",
        "tables.Lines.floats",
    )
    protocols = (
        ".programs.configurations.",
        ".errormodel.",
        ".measurement.kinds.",
        ".gaussian_process.",
    )
    left = [
        name
        for name in missing
        if not name.endswith(general) and not any(p in name for p in protocols)
    ]
    assert left == []
