"""Texts in TOML, and their errors in one line."""

import tomllib
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from calibtool.errors import InputError, near_names

_MOST_DOTS = 2000  # of one line: numbers and dotted keys


def parse_toml(text: str, place: str) -> dict[str, Any]:
    """The keys of a TOML text.

    InputError with `place` for anything else, and for nesting that Python cannot follow.
    """
    if (
        max(line.count(".") for line in text.split("\n")) > _MOST_DOTS
    ):  # tomllib's time grows with the square of a key's
        raise InputError(f"{place}: not valid TOML: a line with more than {_MOST_DOTS} dots")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError(f"{place}: not valid TOML: nested too deeply") from None
    except (
        ValueError
    ) as error:  # TOMLDecodeError is one, and so is an integer of thousands of digits
        raise InputError(f"{place}: not valid TOML: {error}") from None


def validation_message(error: ValidationError, model: type[BaseModel]) -> str:
    """A finding of pydantic as one line: key, what is wrong, near names for an unknown key,
    which comes first.
    """
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
