"""A page on paper: the PDF that a browser, or WeasyPrint, makes of it."""

import os
import shutil
import subprocess
from importlib.util import find_spec

from calibtool.errors import UsageError
from calibtool.unfinished_files import temporary_folder

PAPERS = {"a4": "A4", "letter": "letter"}
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_LONGEST = 120  # s that the browser may take


def to_pdf(page: str, paper: str = "a4") -> bytes:
    """The PDF of an HTML page. paper: `a4` or `letter`.

    UsageError where neither Chromium nor WeasyPrint is installed, or it fails.
    """
    size = f"<style>@page {{ size: {PAPERS[paper]}; }}</style></head>"
    page = page.replace("</head>", size, 1)
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if browser is not None:
        return _by_browser(browser, page)
    if find_spec("weasyprint") is not None:
        import weasyprint

        result: bytes = weasyprint.HTML(string=page).write_pdf()
        return result
    raise UsageError(
        "a PDF needs Chromium or WeasyPrint (pip install 'calibtool[pdf]'); or open the page in a "
        "browser and print it"
    )


def _by_browser(browser: str, page: str) -> bytes:
    with temporary_folder() as folder:
        source, target = folder / "page.html", folder / "page.pdf"
        source.write_text(page, encoding="utf-8")
        options = ["--headless", "--disable-gpu", "--no-pdf-header-footer"]
        options += [f"--user-data-dir={folder}/profile", f"--print-to-pdf={target}"]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            options.append("--no-sandbox")  # of the page alone, which loads nothing
        try:
            subprocess.run(
                [browser, *options, source.as_uri()],
                capture_output=True,
                timeout=_LONGEST,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise UsageError(f"--pdf: {browser} failed: {error}") from None
        if not target.is_file():
            raise UsageError(f"--pdf: {browser} made no PDF; open the page and print it")
        return target.read_bytes()
