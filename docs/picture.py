"""Makes docs/images/report.png, the picture of the README: `python docs/picture.py`.

It is the first screen of the report that docs/how-to/prove-it.md makes; needs Chromium.
"""

import io
import shutil
import subprocess
import tempfile
from pathlib import Path

from console import outputs, page_commands
from PIL import Image

HERE = Path(__file__).resolve().parent
PICTURE = HERE / "images" / "report.png"
_WIDTH, _HEIGHT = 1040, 700


def main() -> None:
    """Run the page's commands, open the report they make, and keep its top in 64 colours."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        commands = page_commands((HERE / "how-to" / "prove-it.md").read_text("utf-8"))
        for _ in outputs(commands, folder):
            pass
        browser = shutil.which("chromium") or "chromium-browser"
        shot = folder / "shot.png"
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        options += [f"--window-size={_WIDTH},{_HEIGHT}", f"--screenshot={shot}"]
        page = (folder / "proof.html").as_uri()
        subprocess.run([browser, *options, page], check=True, capture_output=True, timeout=120)
        picture = Image.open(io.BytesIO(shot.read_bytes())).convert("RGB")
    picture.quantize(64).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
