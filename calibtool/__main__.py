"""The entry point: prints what is being done, then loads the command line, which takes longer."""

import sys  # and nothing else before main: Ctrl-C meets Python's own handler until then

# What each command that may take longer is doing; the others answer at once.
DOING = {
    "simulate": ("simulating", ""),
    "import": ("importing", ""),
    "plan": ("planning", "for"),
    "identify": ("identifying", "from"),
    "train": ("training", "on"),
    "evaluate": ("evaluating", ""),
    "compensate": ("compensating", "with"),
    "export": ("exporting", ""),
    "serve": ("serving", "with"),
    "report": ("reporting", "on"),
    "study": ("studying", ""),
    "monitor": ("checking", "with"),
    "view": ("drawing", ""),
    "plot": ("plotting", ""),
    "demo": ("running the demo", ""),
}


def first_line(arguments: list[str]) -> str | None:
    """The line on a terminal before anything is imported: `training on measurements.h5 …`."""
    words = [word for word in arguments if word not in ("-v", "--verbose", "--debug")]
    if not words or words[0] not in DOING or {"-q", "--quiet", "-h", "--help"} & set(words):
        return None
    verb, preposition = DOING[words[0]]
    if len(words) == 1 or (words[1].startswith("-") and words[1] != "-"):
        return f"{verb} …"
    return " ".join(
        filter(None, (verb, preposition, "stdin" if words[1] == "-" else words[1], "…"))
    )


def _without_traceback(kind: type[BaseException], error: BaseException, trace: object) -> None:
    """Ctrl-C before the command line is loaded: Python ends by the signal, without output."""
    if not issubclass(kind, KeyboardInterrupt):
        sys.__excepthook__(kind, error, trace)  # type: ignore[arg-type]


def main() -> None:
    """Run the command of `sys.argv`; the console script `calibtool`."""
    sys.excepthook = _without_traceback
    line = first_line(sys.argv[1:])
    if line is not None and sys.stderr is not None and sys.stderr.isatty():
        from calibtool.errors import printable

        print(printable(line), file=sys.stderr, flush=True)  # noqa: T201
    from calibtool.cli import main as run

    run()


if __name__ == "__main__":
    main()
