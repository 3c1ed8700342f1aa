"""Make the picture of a report in the documentation: the demo is run and its report is shot.

    python tools/report_picture.py [--seed N] [--runs DIR]

Needs a Chromium. With --runs the report is made of runs that are there: one of each kind.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from hdbench.errors import HdbenchError
from hdbench.report import write_report

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "report.png"
# what comes out of the work stands first: the picture holds the top of the page
KINDS = ("diagnosis", "ripple", "misalignment", "calibration")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
SIZE = "1280,2130"
# colours of a page are few: a palette takes a quarter of the bytes and looks the same
COLOURS = 128


def run_demo(folder: Path, seed: int) -> Path:
    """Run the demo and return the folder of its runs."""
    out = folder / "runs"
    words = ["demo", "--seed", str(seed), "--out", str(out)]
    subprocess.run([sys.executable, "-m", "hdbench_cli", *words], check=True, capture_output=True)
    return out


def newest_of_each(runs: Path) -> list[Path]:
    """Return the newest run of each kind."""
    return [sorted(runs.glob(f"*-{kind}-*"))[-1] for kind in KINDS]


def shoot(page: Path, picture: Path, profile: Path) -> None:
    """Write a picture of the top of a page, in light colours."""
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        sys.exit(f"no browser; needed: one of {', '.join(BROWSERS)}")
    subprocess.run(
        [
            browser,
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            f"--user-data-dir={profile}",
            f"--window-size={SIZE}",
            f"--screenshot={picture}",
            page.as_uri(),
        ],
        check=True,
        capture_output=True,
    )


def shrink(picture: Path) -> None:
    """Reduce the picture to a palette."""
    from PIL import Image

    with Image.open(picture) as image:
        small = image.convert("RGB").quantize(COLOURS)
    small.save(picture, optimize=True)


def main() -> int:
    """Write docs/images/report.png."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="seed of the demo")
    parser.add_argument("--runs", type=Path, help="folder with runs of the demo")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            runs = asked.runs or run_demo(folder, asked.seed)
            files = write_report(newest_of_each(runs), folder / "report.html")
        except HdbenchError as error:
            print(error, file=sys.stderr)
            return error.exit_code
        shoot(files.html, PICTURE, folder / "browser")
    shrink(PICTURE)
    print(f"{PICTURE}: {PICTURE.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
