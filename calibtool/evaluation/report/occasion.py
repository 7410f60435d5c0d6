"""What an acceptance document says beside its figures: who measured what, where and for whom."""

from pydantic import BaseModel, ConfigDict

from calibtool.robot.toml_text import parse_toml, read_model

FIELDS = {
    "serial": "serial number",
    "customer": "customer",
    "operator": "operator",
    "instrument": "instrument",
    "date": "date",
    "temperature": "temperature",
}


class Occasion(BaseModel):
    """The occasion of a report, as text; an empty entry is a blank to be filled in by hand.

    title        heading of the document; empty: that of the robot
    serial, customer, operator, instrument, date, temperature   see `FIELDS`
    calibrations names for people, by the name of the calibration
    """

    model_config = ConfigDict(frozen=True, extra="forbid", coerce_numbers_to_str=True)

    title: str = ""
    serial: str = ""
    customer: str = ""
    operator: str = ""
    instrument: str = ""
    date: str = ""
    temperature: str = ""
    calibrations: dict[str, str] = {}

    @property
    def entries(self) -> list[tuple[str, str]]:
        """Name and value of every entry but the title, in the order of the document."""
        return [(name, getattr(self, key)) for key, name in FIELDS.items()]

    def changed(self, given: dict[str, str | None]) -> "Occasion":
        """The same with what is given, by field; None changes nothing."""
        return self.model_copy(update={k: v for k, v in given.items() if v is not None})


def parse_occasion(text: str, name: str) -> Occasion:
    """The occasion from a TOML text called `name`. InputError for anything else."""
    values = parse_toml(text, name)
    for key, value in values.items():
        if not isinstance(value, dict | list):
            values[key] = str(value)  # a date, a number of degrees
    return read_model(Occasion, values, name)
