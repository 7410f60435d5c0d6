"""Statuses of corrected rows, and their descriptions."""

OK = "ok"
JUMP = "jump"
OUTSIDE = "outside"
PARTIAL = "partial"
LIMITED = "limited"
NEAR_SINGULAR = "near-singular"
OUT_OF_LIMITS = "out-of-limits"
UNCORRECTED = "uncorrected"
UNREACHABLE = "unreachable"
NOT_CLOSED = "not-closed"

CORRECTED = (OK, JUMP, OUTSIDE)  # no error remains except what no joint can correct
DOUBTFUL = (
    PARTIAL,
    LIMITED,
    NEAR_SINGULAR,
    OUT_OF_LIMITS,
    UNCORRECTED,
    NOT_CLOSED,
)  # a part of it, or all, remains

MEANING = {
    JUMP: "the correction changes by more than 15 % of the commanded step from the row before",
    OUTSIDE: "outside the configurations of the training",
    PARTIAL: "corrected in part",
    LIMITED: "a joint is held at the largest change",
    NEAR_SINGULAR: "near a singularity: its step may be damped",
    OUT_OF_LIMITS: "a joint is held at its limit, or outside its limits",
    UNCORRECTED: "no better joints found: as commanded",
    NOT_CLOSED: "the closed loops do not close there: as commanded",
    UNREACHABLE: "the pose is unreachable: no joints are given",
}
