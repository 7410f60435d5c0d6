"""calibtool: make a serial robot accurate in software, from its description and a set
of measurements.

The rooms, in the order in which data flows through them: `robot`, `errormodel`, `measurement`,
`identification`, `planning`, `equivalent`, `calibration`, `compensation`, `controller`, `programs`,
`export`, `evaluation`; `storage` and `tables` read and write files; `cli` is the command line on
top. What scripts need of them stands here (docs/library.md) and is imported when it is asked for;
`__init__.pyi` has the same names for editors and type checkers.

Conventions, everywhere: metres and radians; twists are (v, ω), linear part first; `T_a_b` is the
pose of frame b in frame a; joint positions `q` have one coordinate per joint.
"""

__version__ = "0.1.0"

_PLACES = {
    "robot.catalogue": ("load_robot", "robot_names"),
    "robot.shipped": ("shipped",),
    "robot.robot": ("Robot",),
    "errormodel.actual": ("ErrorScales",),
    "measurement.simulate": ("Simulation", "simulate"),
    "measurement.measurements": ("Measurements",),
    "measurement.importing": ("Stated", "import_table", "parse_column_map", "read_table"),
    "measurement.checks": ("check_measurements",),
    "planning.information": ("Knowledge",),
    "planning.constraints": ("Constraints",),
    "planning.plan": ("Plan", "make_plan"),
    "calibration": ("Calibration", "identify", "train"),
    "calibration.fit": ("BaseOptions",),
    "identification.complete": ("CompleteOptions",),
    "equivalent.training": ("TrainingOptions",),
    "compensation.solve": ("Compensation", "compensate_joints", "compensate_poses"),
    "controller": ("ControllerModel", "read_controller_model"),
    "programs.program_summary": ("CompensatedProgram",),
    "programs.compensate": ("compensate_program",),
    "programs.correction": ("ProgramOptions",),
    "evaluation.compare": ("Evaluation", "evaluate"),
    "evaluation.drift": ("DriftCheck", "check_drift"),
    "export.as_json": ("calibration_as_json",),
    "export.c_code": ("calibration_as_c",),
    "storage.paths": ("read", "write"),
    "errors": ("AcceptanceError", "CalibtoolError", "InputError", "NoSolutionError", "UsageError"),
    "evaluation.metrics": ("MethodResult", "Statistics"),
    "evaluation.plots.figures": ("Subject", "draw"),
    "evaluation.report.report_page": ("html_report",),
    "evaluation.view.scene": ("Scene", "scene_of"),
    "evaluation.view.scene_page": ("page_of",),
    "evaluation.study.definition": ("Definition", "Study"),
    "evaluation.study.local": ("run_study",),
    "evaluation.study.study_table": ("StudyTable",),
}
_MODULES = {name: f"calibtool.{place}" for place, names in _PLACES.items() for name in names}

__all__ = sorted([*_MODULES, "__version__"])


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'calibtool' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})
