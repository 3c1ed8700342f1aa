"""Build sdist and wheel; install the wheel into a bare environment and use it (`make wheel`)."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMPILED = ("hdbench/filter/_kernel",)


def run(*command: str | Path, cwd: Path) -> str:
    """Run a command and return what it prints."""
    done = subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(
            f"{' '.join(map(str, command))}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
        )
    return done.stdout


def use() -> None:
    """Use the installed hdbench: a simulated run through the compiled filter."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        hdbench = (sys.executable, "-P", "-m", "hdbench_cli")
        told = json.loads(run(*hdbench, "doctor", "--json", cwd=folder))
        if not told["kernel"].startswith("c "):
            raise SystemExit(f"the filter is not compiled: {told['kernel']}")
        run(*hdbench, "simulate", "--duration", "5", "--out", "trace.csv", cwd=folder)
        run(*hdbench, "filter", "trace.csv", "--out", "filtered.csv", cwd=folder)
        rows = len((folder / "filtered.csv").read_text().splitlines())
        print(
            f"hdbench {told['hdbench_version']}: kernel {told['kernel']}; filtered {rows - 1} rows"
        )


def check_sdist(file: Path) -> None:
    """Refuse a source archive with tests, or without what is compiled."""
    with tarfile.open(file) as archive:
        names = [name.partition("/")[2] for name in archive.getnames()]
    tests = [name for name in names if name.startswith("tests/")]
    missing = [str(p) for p in tracked("hdbench", "cli", "profiles") if str(p) not in names]
    if tests or missing:
        raise SystemExit(f"{file.name}: holds {tests[:3]}, misses {missing[:3]}")


def check_wheel(file: Path) -> None:
    """Refuse a wheel that serves one Python alone, or in which a file is missing."""
    with zipfile.ZipFile(file) as archive:
        names = archive.namelist()
    if "-cp311-abi3-" not in file.name:
        raise SystemExit(f"{file.name}; needed: cp311-abi3")
    wanted = [installed(path) for path in tracked("hdbench", "cli", "profiles")]
    missing = [name for name in wanted if name not in names]
    missing += [stem for stem in COMPILED if not any(name.startswith(stem) for name in names)]
    if missing:
        raise SystemExit(f"{file.name} misses {missing}")


def tracked(*folders: str) -> list[Path]:
    """Return the files of the repository in some folders."""
    return [Path(name) for name in run("git", "ls-files", *folders, cwd=ROOT).split()]


def installed(path: Path) -> str:
    """Return where a file of the repository stands in a wheel."""
    first, *rest = path.parts
    return "/".join(
        rest if first == "cli" else ["hdbench_profiles" if first == "profiles" else first, *rest]
    )


def main() -> int:
    """Build, check, install, use."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--use", action="store_true", help="only use the hdbench that is installed")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "dist")
    asked = parser.parse_args()
    if asked.use:
        use()
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # from the files of the repository alone: what was built before does not come along
        source = folder / "source"
        for path in tracked(
            "hdbench", "cli", "profiles", "*.toml", "*.py", "*.in", "*.md", "LICENSE"
        ):
            if path.parts[0] not in ("tests", "tools", "docs", "examples"):
                (source / path).parent.mkdir(parents=True, exist_ok=True)
                (source / path).write_bytes((ROOT / path).read_bytes())
        run(sys.executable, "-m", "build", "--outdir", asked.out, source, cwd=folder)
        sdist, wheel = max(asked.out.glob("*.tar.gz")), max(asked.out.glob("*.whl"))
        check_sdist(sdist)
        check_wheel(wheel)
        venv.create(folder / "bare", with_pip=True)
        python = folder / "bare" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
        run(python, "-m", "pip", "install", "--quiet", wheel, cwd=folder)
        print(f"{sdist.name}, {wheel.name}")
        print(run(python, "-P", ROOT / "tools" / "wheel.py", "--use", cwd=folder), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
