"""calibtool serve: a compensator for a program that moves."""

import contextlib
import sys
from typing import TYPE_CHECKING, Annotated, BinaryIO, cast

import typer

from calibtool.cli.calibration_options import CalibrationOptions
from calibtool.cli.files import STREAM, message, shown, write_stdout
from calibtool.cli.input_files import say_doubts
from calibtool.cli.options import (
    CalibrationFile,
    JointValuesOption,
    LargestChange,
    Outside,
    TakeUpBacklash,
    check_solving,
    choice,
    joint_values_of,
    largest_change,
)
from calibtool.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from calibtool.compensation.row_by_row import Live, RowKind

ROWS = ("ndjson", "binary")
LOOPBACK = "127.0.0.1"
_LONGEST = 100_000  # bytes that a line may have
_WARM = 20  # number of corrections before the first row, so that everything is loaded


def serve(
    *,
    calibration: CalibrationFile,
    port: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            help="Serve a socket of this machine (127.0.0.1) instead of stdin and stdout; "
            "0: any free one.",
        ),
    ] = None,
    rows: Annotated[
        str,
        typer.Option(
            metavar="ndjson|binary",
            help="JSON objects, one per line, or rows of doubles (little endian): n in, n and the "
            "status out.",
        ),
    ] = "ndjson",
    method: Annotated[
        str,
        typer.Option(
            "--method", metavar="one-step|exact", help="One damped step, or solve exactly."
        ),
    ] = "one-step",
    outside: Outside = "mark",
    backlash: TakeUpBacklash = True,
    largest_change_deg: LargestChange = None,
    joint_values: JointValuesOption = None,
    conditions: CalibrationOptions,
) -> None:
    """Correct joint positions while the arm moves.

    For a program that moves the arm: for each row in, one corrected row comes out at once. Rows
    come from stdin until it ends, or from a socket of this machine (--port) until Ctrl-C. Every
    client of the socket is a path of its own.

    A row is a JSON object with a key per joint (j1_deg, j2_mm …). The answer has the corrected
    joints, a status, and the other keys. A line that cannot be answered gets {"error": ...}.
    docs/serving.md has the binary rows, clients and delays.

    Example: calibtool serve calibration.h5 --port 5005
    """
    choice(rows, ROWS, "--rows")
    if calibration == STREAM and port is None:
        raise UsageError("stdin holds the rows; give the calibration as a file, or use --port")
    from calibtool.compensation.row_by_row import Live, RowKind
    from calibtool.compensation.solve import Method
    from calibtool.compensation.targets import OutsidePolicy

    check_solving(method, outside)
    most, values = largest_change(largest_change_deg), joint_values_of(joint_values)
    loaded = conditions.load(calibration)
    whose = loaded.robot.joint_values(shown(calibration), values)
    say_doubts(loaded.robot)

    def live() -> Live:
        return Live(
            loaded, whose, cast(Method, method), cast(OutsidePolicy, outside), backlash, most
        )

    warmed = live()
    for _ in range(_WARM):
        warmed.corrected(loaded.robot.serial_as(whose, loaded.q[:1])[0])
    kind = cast(RowKind, rows)
    if port is None:
        answer_rows(live(), kind, sys.stdin.buffer, write_stdout)
        return
    _serve_socket(port, kind, live)


def answer_rows(
    live: "Live", kind: "RowKind", stream: BinaryIO, write: "Callable[[bytes], None]"
) -> None:
    """Answer rows until the stream ends; a part of a row at the end is not answered."""
    size, answer = live.answering(kind)
    while True:
        row = stream.read(size) if size else stream.readline(_LONGEST)
        if len(row) < (size or 1):
            return
        if size or row.strip():
            write(answer(row))


def _serve_socket(port: int, kind: "RowKind", live: "Callable[[], Live]") -> None:
    import socket
    import socketserver

    class Client(socketserver.StreamRequestHandler):
        disable_nagle_algorithm = True

        def handle(self) -> None:
            with contextlib.suppress(ConnectionError):  # a client that went away
                answer_rows(live(), kind, self.rfile, self.wfile.write)  # type: ignore[arg-type]

    class Server(socketserver.ThreadingTCPServer):
        daemon_threads = True
        allow_reuse_address = True

    try:
        server = Server((LOOPBACK, port), Client)
    except OSError as error:
        raise UsageError(
            f"port {port}: {error.strerror or error}; choose another one, or 0 for a free one"
        ) from None
    with server, contextlib.suppress(socket.error):
        message(f"serving {LOOPBACK}:{server.server_address[1]} until ended", important=True)
        server.serve_forever()
