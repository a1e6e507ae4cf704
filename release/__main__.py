"""Build wheel, sdist and SBOM into ``dist/``, and check the wheel in fresh environments.

    python -m release TEST…                      in each supported Python that is found, with
                                                 the lowest dependencies and with the newest
    python -m release --only 3.12-newest TEST…   in some of them; the option may be repeated

``PYTHONS="/opt/a/bin/python /opt/b/bin/python"`` names further interpreters.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
TOOLS = Path(sys.executable).parent
SUPPORTED = ("3.11", "3.12", "3.13", "3.14")
RESOLUTIONS = {"lowest": "lowest-direct", "newest": "highest"}
VERSION_OF = "import sys; print('%d.%d' % sys.version_info[:2])"
PLACE_OF = "import vibrident; print(vibrident.__file__, vibrident.__version__)"


def main(arguments: Sequence[str] | None = None) -> int:
    """Build and check; return the number of environments that failed."""
    parser = argparse.ArgumentParser(prog="python -m release", description=__doc__)
    environments = [f"{version}-{name}" for version in SUPPORTED for name in RESOLUTIONS]
    parser.add_argument("--only", action="append", choices=environments, default=[])
    parser.add_argument("--jobs", default="2", help="test processes")
    parser.add_argument("tests", nargs="+", metavar="TEST")
    options = parser.parse_args(arguments)
    wheel = build()
    interpreters = find_interpreters()
    write_sbom(wheel, next(iter(interpreters.values())))
    outcomes = {}
    for environment in options.only or environments:
        version, _, name = environment.partition("-")
        if version not in interpreters:
            outcomes[environment] = "not checked: no such Python found"
        elif check(wheel, interpreters[version], RESOLUTIONS[name], options.jobs, options.tests):
            outcomes[environment] = "passed"
        else:
            outcomes[environment] = "FAILED"
    print(f"\n{wheel.name}")
    for environment, outcome in outcomes.items():
        print(f"  {environment:12} {outcome}")
    return sum(outcome == "FAILED" for outcome in outcomes.values())


def build() -> Path:
    """Build the sdist, and the wheel from it; return the wheel."""
    shutil.rmtree(DIST, ignore_errors=True)
    run(TOOLS / "python", "-m", "build", "--installer", "uv", "--outdir", DIST, ROOT)
    run(TOOLS / "python", "-m", "twine", "check", "--strict", *sorted(DIST.iterdir()))
    (wheel,) = DIST.glob("*.whl")
    return wheel


def find_interpreters() -> dict[str, str]:
    """Find an interpreter of each supported version; a candidate is run, as a shim may be empty."""
    interpreters: dict[str, str] = {}
    for candidate in candidates():
        try:
            version = run(candidate, "-c", VERSION_OF, capture=True)
        except (OSError, subprocess.CalledProcessError):
            continue
        if version in SUPPORTED:
            interpreters.setdefault(version, candidate)
    if not interpreters:
        sys.exit(f"No Python of {', '.join(SUPPORTED)} found: set PYTHONS to their paths.")
    return interpreters


def candidates() -> Iterator[str]:
    """Interpreters in the order in which they are tried."""
    yield from os.environ.get("PYTHONS", "").split()
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in SUPPORTED:
        yield f"python{version}"
        yield from (str(path) for path in sorted(pyenv.glob(f"{version}.*/bin/python")))


def write_sbom(wheel: Path, interpreter: str) -> None:
    """Write the bill of materials (CycloneDX 1.6) of the wheel and its newest dependencies."""
    name, version, *_ = wheel.name.split("-")
    target = DIST / f"{name}-{version}.cdx.json"
    with tempfile.TemporaryDirectory() as folder:
        python = make_environment(Path(folder), interpreter)
        uv("pip", "install", "--python", python, wheel)
        form = ("--spec-version", "1.6", "--mc-type", "library", "--output-reproducible")
        output = (*form, "--output-file", target, "--pyproject", "pyproject.toml")
        run(TOOLS / "cyclonedx-py", "environment", *output, python)
    bill = json.loads(target.read_text(encoding="utf-8"))
    # pyproject.toml takes the version from the sources, where the tool does not look.
    bill["metadata"]["component"] |= {"version": version, "purl": f"pkg:pypi/{name}@{version}"}
    target.write_text(json.dumps(bill, indent=2) + "\n", encoding="utf-8")


def check(wheel: Path, interpreter: str, resolution: str, jobs: str, tests: Sequence[str]) -> bool:
    """Run tests on the installed wheel; return whether they pass."""
    with tempfile.TemporaryDirectory() as folder:
        python = make_environment(Path(folder), interpreter)
        # pyproject.toml is given, as only its own dependencies count as direct ones.
        dependencies = ("-r", "pyproject.toml", "--extra", "test", "--only-binary", ":all:")
        pytest = ("-m", "pytest", "-n", jobs, "--dist", "worksteal", "-p", "no:cacheprovider")
        try:
            uv("pip", "install", "--python", python, "--resolution", resolution, *dependencies)
            uv("pip", "install", "--python", python, "--no-deps", wheel)
            uv("pip", "check", "--python", python)
            uv("pip", "freeze", "--python", python)
            run(python, "-c", PLACE_OF)
            run(python, *pytest, *tests)
        except subprocess.CalledProcessError as error:
            print(error, file=sys.stderr)
            return False
    return True


def make_environment(folder: Path, interpreter: str) -> Path:
    """Make an empty environment; return its interpreter."""
    uv("venv", "--quiet", "--python", interpreter, folder / "venv")
    return folder / "venv" / "bin" / "python"


def uv(*arguments: str | Path) -> None:
    """Run uv."""
    run(TOOLS / "uv", *arguments)


def run(*command: str | Path, capture: bool = False) -> str:
    """Run a command in the root of the repository; return what it prints, where that is captured.

    Raises:
        CalledProcessError: it did not end with zero.
    """
    words = [str(word) for word in command]
    if not capture:
        print("+", *words, flush=True)
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    output = subprocess.PIPE if capture else None
    streams = {"stdout": output, "stderr": output}
    done = subprocess.run(words, cwd=ROOT, env=variables, text=True, **streams)
    done.check_returncode()
    return (done.stdout or "").strip()


if __name__ == "__main__":
    sys.exit(main())
