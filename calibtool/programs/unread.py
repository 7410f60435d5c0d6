"""Programs of controllers in languages that cannot be read, recognised by their beginning."""

import re

_UNREAD = {
    rb"\x1f\x8b|(?:<\?xml[^>]*>\s*)?<URProgram\b": "a PolyScope program (.urp); give the .script "
    "that PolyScope saves beside it",
    rb"\s*Program\s+(?:Robot Program|BeforeStart|Init)\b": "a listing of a PolyScope program; give "
    "the .script that PolyScope saves beside it",
    rb"\s*/JOB\b": "a job of a Yaskawa controller (.JBI)",
    rb"\s*\.PROGRAM\b": "a program of a Kawasaki controller (AS)",
    rb"(?:<\?xml[^>]*>\s*)?<Programs?\b": "a program of a Staubli controller (VAL 3)",
    rb"\s*(?:%\s*)?(?:[:O]\d+[^\n]*\s+)?(?:N\d+\s*)?G\d{1,3}(?:\s|[A-Z][\d.+-])": "G-code",
    rb"\s*PROGRAM\s+\w+\s[^=]*?\b(?:VAR|BEGIN|CONST|GIVE ARM|TAKEARM)\b": "a program in KAREL, PAC "
    "or PDL2",
}
_READ = "fanuc-ls, kuka-krl, abb-rapid, ur-script and ros2-trajectory are read"
_KINDS = {re.compile(begins): what for begins, what in _UNREAD.items()}


def unread_program(head: bytes) -> str | None:
    """The kind of a file and what can be read instead, if it begins like a program that cannot be
    read; otherwise None.
    """
    for begins, what in _KINDS.items():
        if begins.match(head):
            return f"{what}; {_READ}" if "give" not in what else what
    if b"\0" in head[:512] and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "a binary file; programs are read as text (of FANUC controllers .LS, not .TP)"
    return None
