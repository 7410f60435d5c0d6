"""Texts in TOML, and their errors in one line."""

import tomllib
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from calibtool.errors import InputError, near_names

M = TypeVar("M", bound=BaseModel)
_MOST_DOTS = 2000  # of one line: numbers and dotted keys


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """The keys of a TOML text.

    InputError with `place` for anything else, and for nesting that Python cannot follow.
    """
    # tomllib's time grows with the square of a key's length.
    if max(line.count(".") for line in text.split("\n")) > _MOST_DOTS:
        raise InputError(f"{place}: not valid TOML: a line with more than {_MOST_DOTS} dots")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{place}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # TOMLDecodeError, or an integer of thousands of digits
        raise InputError(f"{place}: not valid TOML: {error}") from None


def read_model(model: type[M], keys: dict[str, Any], place: str) -> M:
    """A model from the keys of a TOML text. InputError with `place` and the key that is wrong."""
    try:
        return model.model_validate(keys)
    except ValidationError as error:
        raise InputError(f"{place}: {validation_message(error, model)}") from None


def validation_message(error: ValidationError, model: type[BaseModel]) -> str:
    """A finding of pydantic in one line: key, problem, near names for an unknown key (first)."""
    findings = error.errors()
    first = next(
        (finding for finding in findings if finding["type"] == "extra_forbidden"), findings[0]
    )
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        known = _fields_at(model, first["loc"][:-1])
        return f"unknown key '{key}'" + (
            f"; {near_names(str(first['loc'][-1]), known)}" if known else ""
        )
    message = first["msg"].removeprefix("Value error, ")
    return f"{key}: {message}" if key else message


def _fields_at(model: type[BaseModel], path: tuple[int | str, ...]) -> list[str]:
    """Keys of the model at `path` inside another one; none if they are not known."""
    for part in path:
        if isinstance(part, int) or part not in model.model_fields:
            # an element of a list or of a table with free names: the model is already
            # that of its values
            continue
        inner = _models_in(model.model_fields[part].annotation)
        if not inner:
            return []
        model = inner[0]
    return list(model.model_fields)


def _models_in(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models_in(argument)]
