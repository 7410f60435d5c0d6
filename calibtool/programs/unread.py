"""Programs of controllers in languages that cannot be read, recognised by their contents."""

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
# what only such programs have, at the beginning of lines or anywhere
_LINES = {
    rb"^import[ \t]+[\w.]+(?:[ \t]+as[ \t]+\w+)?[ \t]*(?:#.*)?\r?$"
    rb"|^from[ \t]+(?!DRCF)[\w.]+[ \t]+import\b": "a Python script; give the program that it makes",
    rb"\b(?:pos[jx]|set_(?:vel|acc)[jx]|amove[jlc])[ \t]*\(|\bDR_(?:BASE|TOOL|MV)"
    rb"|\bmove[jlc][ \t]*\([^\n#]{0,300}\b(?:vel|acc)[ \t]*=": "a program of a Doosan arm (DRL)",
    rb"^[ \t]*Fend\b": "a program of an Epson controller (SPEL+)",
    rb"^[ \t]*(?:\d+[ \t]+)?[PJ]\w*[ \t]*=[ \t]*"
    rb"\((?:[-+\d. \t]+,){2,}[-+\d. \t]*\)": "a program of a Mitsubishi controller (MELFA-BASIC)",
    rb"^[ \t]*(?:\d+[ \t]+)?MOVEX?[ \t]+A=\d": "a program of a Nachi controller (SLIM)",
    rb"^[ \t]*(?i:TakeArm|GiveArm)\b": "a program of a Denso controller (PAC, PacScript)",
    rb"^Program File Format Version\b": "a job of a Hyundai controller (.JOB)",
    rb"^[ \t]*Mov[JL][ \t]*\(": "a program of a Dobot controller",
    rb"^[ \t]*mov[jl][ \t]*\(": "a program of a JAKA controller",
    rb"^[ \t]*(?:PTP|P?Line|Circle)[ \t]*\([ \t]*\"[CJ][PRA]": "a program of a Techman controller",
}
_READ = "fanuc-ls, kuka-krl, abb-rapid, ur-script and ros2-trajectory are read"
_KINDS = {
    **{re.compile(rb"\A(?:%s)" % begins): what for begins, what in _UNREAD.items()},
    **{re.compile(line, re.MULTILINE): what for line, what in _LINES.items()},
}


def unread_program(head: bytes) -> str | None:
    """The kind of a file and what can be read instead, if its first part is that of a program that
    cannot be read; otherwise None.
    """
    for pattern, what in _KINDS.items():
        if pattern.search(head):
            return f"{what}; {_READ}" if "give" not in what else what
    if b"\0" in head[:512] and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "a binary file; programs are read as text (of FANUC controllers .LS, not .TP)"
    return None
