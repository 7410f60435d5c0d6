"""How a calibration is loaded by `compensate`, `serve` and `export`: conditions and frame."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from calibtool.cli.input_files import load_calibration
from calibtool.cli.options import FrameOption
from calibtool.errors import UsageError

if TYPE_CHECKING:
    from calibtool.calibration import Calibration


@dataclass(frozen=True)
class CalibrationOptions:
    """A calibration is used for one payload, at one temperature and in one frame."""

    payload_kg: Annotated[
        float | None,
        typer.Option(
            "--payload-kg", min=0, help="Mass at the tool, for a calibration that knows it."
        ),
    ] = None
    temperature_c: Annotated[
        float | None,
        typer.Option(
            "--temperature-c",
            min=-273.15,
            help="Temperature of the links, for a calibration that knows it.",
        ),
    ] = None
    frame: FrameOption = None

    def load(self, path: str) -> "Calibration":
        """The calibration of a file, for these options.

        UsageError for a condition without a family of errors in the calibration.
        """
        from calibtool.errormodel.operating_conditions import Conditions
        from calibtool.robot.se3 import readonly

        calibration, _ = load_calibration(path, self.frame)
        present = {family.id for family in calibration.base.errors.present}
        given = {"payload_kg": self.payload_kg, "temperature_c": self.temperature_c}
        for column, value in given.items():
            family = column.partition("_")[0]
            if value is not None and family not in present:
                raise UsageError(
                    f"--{column.replace('_', '-')}: this calibration does not know what the "
                    f"{family} does; identify it from measurements with a column {column}"
                )
        known = {name: None if value is None else readonly(value) for name, value in given.items()}
        conditions = Conditions(**known)
        conditions.check((0, calibration.robot.n), "options")
        return calibration.at(conditions)
