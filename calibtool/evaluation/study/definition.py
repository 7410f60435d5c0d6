"""Definition of a study, from a TOML file or options, and its runs."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, field_validator

from calibtool import __version__
from calibtool.errormodel.actual import ErrorScales
from calibtool.errormodel.families import ERROR_KINDS
from calibtool.errors import CalibtoolError, UsageError, near_names
from calibtool.robot.catalogue import load_robot
from calibtool.robot.toml_text import parse_toml, read_model, validation_message

NOMINAL = "nominal"
METHODS = (NOMINAL, "local-poe", "complete", "network", "network-local-poe", "default")
LARGEST = 1_000_000  # number of runs that one study may have

T = TypeVar("T")


def _as_list(value: Any) -> Any:
    """A single value is a list of one; repeated values count once."""
    values = value if isinstance(value, list | tuple) else [value]
    return [v for i, v in enumerate(values) if v not in values[:i]]


Several = Annotated[list[T], BeforeValidator(_as_list), Field(min_length=1)]
Size = Annotated[float, Field(ge=0)]


class Definition(BaseModel):
    """The keys of a `--plan` file.

    Lists are varied against each other; a single value stands for a list of one.

    robots          names of the catalogue or paths
    workspace       of every robot; None: each robot's first
    runs            actual robots per combination, each with a seed of its own
    configurations  measured ones
    errors          kinds of errors: `all`, or a comma list such as `geometric,gear`
    error_scale     factor on all sizes of errors
    noise_mm        standard deviation per coordinate
    methods         of METHODS; `nominal` is always among them
    fresh           configurations of the same robot for judging; 0: judge on the measured
                    ones, as Song, Tian and Ma do
    *_mm, *_mrad, *_k   sizes of the errors, as in `ErrorScales`
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    robots: Annotated[list[str], BeforeValidator(_as_list)] = []
    workspace: str | None = None
    runs: Annotated[int, Field(ge=1)] = 100
    seed: Annotated[int, Field(ge=0)] = 0
    configurations: Several[Annotated[int, Field(ge=1)]] = [100]
    errors: Several[str] = ["geometric"]
    error_scale: Several[Size] = [1.0]
    noise_mm: Several[Size] = [0.05]
    methods: Several[str] = ["local-poe", "network", "complete"]
    fresh: Annotated[int, Field(ge=0)] = 1000
    length_error_mm: Size = 0.5
    angle_error_mrad: Size = 0.5
    gear_mrad: Size = 0.2
    gravity_mrad: Size = 0.5
    backlash_mrad: Size = 0.1
    payload_mrad: Size = 0.5
    thermal_k: Size = 10.0

    @field_validator("methods")
    @classmethod
    def _known_methods(cls, methods: list[str]) -> list[str]:
        for method in methods:
            if method not in METHODS:
                raise ValueError(f"unknown method '{method}'; {near_names(method, METHODS)}")
        return [NOMINAL, *(method for method in methods if method != NOMINAL)]

    @field_validator("errors")
    @classmethod
    def _known_errors(cls, errors: list[str]) -> list[str]:
        return list(dict.fromkeys(",".join(_kinds(text)) for text in errors))

    def scales(self, kinds: str, factor: float) -> ErrorScales:
        """Sizes of the errors of one combination, in SI."""
        return ErrorScales.of(tuple(kinds.split(",")), vars(self), factor)

    def changed(self, changes: Mapping[str, object]) -> "Definition":
        """The definition with some keys replaced, for options over a file.

        UsageError names the option that is wrong.
        """
        try:
            return Definition.model_validate({**self.model_dump(), **changes})
        except ValidationError as error:
            finding = validation_message(error, Definition)
            key, _, text = finding.partition(": ")
            raise UsageError(f"--{key.split('.')[0].replace('_', '-')}: {text}") from None


def _kinds(text: str) -> list[str]:
    """Kinds of errors in their fixed order."""
    wanted = [part.strip() for part in text.split(",")]
    if wanted == ["all"]:
        return list(ERROR_KINDS)
    for kind in wanted:
        if kind not in ERROR_KINDS:
            raise ValueError(
                f"unknown kind of error '{kind}'; {near_names(kind, ('all', *ERROR_KINDS))}"
            )
    return [kind for kind in ERROR_KINDS if kind in wanted]


def parse_definition(text: str, name: str) -> Definition:
    """A definition from TOML text. Raises InputError with the key that is wrong."""
    return read_model(Definition, parse_toml(text, name), name)


@dataclass(frozen=True)
class Run:
    """One actual robot of one combination; `number`, from 1, is the same robot in each of them."""

    robot: int  # index in Study.robots
    configurations: int
    errors: str
    error_scale: float
    noise_mm: float
    number: int
    seed: int


@dataclass(frozen=True)
class RobotText:
    """A robot as text, so that a run needs no file of the machine that defined it."""

    toml: str
    urdf: str
    place: str
    workspace: str  # the resolved name


@dataclass(frozen=True)
class Study:
    """A definition with its robots read: everything that a worker needs for any run.

    definition  what is varied, and how runs are made and judged
    robots      texts of their descriptions
    version     of the calibtool that made it; another one does not run it
    """

    definition: Definition
    robots: tuple[RobotText, ...]
    version: str = __version__

    @classmethod
    def of(cls, definition: Definition) -> "Study":
        """Read the robots.

        UsageError for an unknown robot or workspace, or when there is no robot or too many runs.
        """
        if not definition.robots:
            raise UsageError("no robot; name one, or give --plan STUDY.toml with robots = [...]")
        texts = []
        for name in definition.robots:
            robot = load_robot(name)
            workspace = robot.workspace(definition.workspace).name
            texts.append(RobotText(robot.source.toml_text, robot.source.urdf_text, name, workspace))
        study = cls(definition, tuple(texts))
        if study.count > LARGEST:
            raise UsageError(f"{study.count:,} runs; a study has at most {LARGEST:,}")
        return study

    @cached_property
    def key(self) -> str:
        """Twelve hexadecimal digits of the SHA-256 of everything that determines the results."""
        parts = [
            self.version,
            self.definition.model_dump_json(),
            *(t for r in self.robots for t in (r.toml, r.urdf)),
        ]
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:12]

    @cached_property
    def _combinations(self) -> list[tuple[int, str, float, float, int]]:
        d = self.definition
        return list(
            product(range(len(self.robots)), d.errors, d.error_scale, d.noise_mm, d.configurations)
        )

    @property
    def count(self) -> int:
        """Number of runs."""
        return len(self._combinations) * self.definition.runs

    def run(self, index: int) -> Run:
        """Run `index`, 0 … count−1.

        Its seed comes from the study's seed and the number alone: paired combinations.
        """
        combination, replicate = divmod(index, self.definition.runs)
        robot, errors, scale, noise, configurations = self._combinations[combination]
        stream = np.random.SeedSequence(self.definition.seed, spawn_key=(replicate,))
        # 53 bits: exact in any JSON reader
        seed = int(stream.generate_state(1, np.uint64)[0] >> np.uint64(11))
        return Run(robot, configurations, errors, scale, noise, replicate + 1, seed)

    def check_version(self, version: str) -> None:
        """CalibtoolError unless a worker's calibtool is the one that defined the study."""
        if version != self.version:
            raise CalibtoolError(
                f"a worker has calibtool {version}, this is {self.version}; install "
                "the same on both"
            )
