"""Monte Carlo studies: definition → runs → local processes or Dask → table and summary."""

from calibtool.evaluation.study.definition import METHODS, Definition, Study, parse_definition
from calibtool.evaluation.study.runs import perform
from calibtool.evaluation.study.study_table import StudyTable

__all__ = ["METHODS", "Definition", "Study", "StudyTable", "parse_definition", "perform"]
