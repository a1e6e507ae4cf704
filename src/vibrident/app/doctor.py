"""Check whether this installation is fit to identify a sensor."""

from __future__ import annotations

import importlib.metadata
import itertools
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from vibrident.app.requirements import MISSING, requirements_by_extra, unusable_packages
from vibrident.base.errors import InputError
from vibrident.data.registry import READERS, SOURCES
from vibrident.export.registry import EXPORTS
from vibrident.fit.registry import DEPARTURES, ESTIMATORS
from vibrident.physics.registry import MODELS

MIN_PYTHON = (3, 11)
MAX_PYTHON = (3, 14)  # Python versions that it is tested with
REGISTRIES = (MODELS, ESTIMATORS, DEPARTURES, READERS, SOURCES, EXPORTS)  # of what plug-ins can add
MAX_DEVIATION_U = 4.0  # a sound estimate lies this close to the truth, in standard uncertainties


Verdict = Literal["ok", "not installed", "cannot be used"]


@dataclass(frozen=True)
class Check:
    """Result of one check."""

    subject: str  # what
    finding: str  # what was found; where it cannot be used, why
    verdict: Verdict = "ok"
    remedy: str = ""  # what to do; also a hint where all is well but could be better
    vital: bool = True  # False where the installation is fit for use without it

    @property
    def fatal(self) -> bool:
        """Return whether results could be wrong or missing."""
        return self.vital and self.verdict != "ok"


def _check(subject: str, finding: str, *, usable: bool, remedy: str, vital: bool = True) -> Check:
    """Return a check with its remedy where it is not usable."""
    if usable:
        return Check(subject, finding)
    return Check(subject, finding, "cannot be used", remedy, vital)


def examine() -> list[Check]:
    """Make every check, in order; one that fails does not keep the others from being made."""
    checks: list[Callable[[], list[Check]]] = [
        _python,
        _packages_and_extras,
        _plug_ins,
        _jax,
        _cache,
        _store,
        _identification,
    ]
    results: list[Check] = []
    for check in checks:
        try:
            results += check()
        except Exception as error:  # whatever is broken here is what the doctor is asked about
            subject = check.__name__.strip("_").replace("_", " ").capitalize()
            message = f"{type(error).__name__}: {error}"
            remedy = "see the message; reinstall vibrident"
            results.append(Check(subject, message, "cannot be used", remedy))
    return results


def _python() -> list[Check]:
    fits = MIN_PYTHON <= sys.version_info[:2] <= MAX_PYTHON
    remedy = f"use Python {MIN_PYTHON[0]}.{MIN_PYTHON[1]} to {MAX_PYTHON[0]}.{MAX_PYTHON[1]}"
    version = f"{platform.python_version()}, {platform.machine()}"
    return [_check("Python", version, usable=fits, remedy=remedy)]


def _packages_and_extras() -> list[Check]:
    """Look for the packages that all needs, then for those of each extra; each is loaded."""
    by_extra = requirements_by_extra()
    unusable = unusable_packages(itertools.chain.from_iterable(by_extra.values()))
    checks = []
    for extra, requirements in by_extra.items():
        names = sorted({requirement.name for requirement in requirements})
        missing = [name for name in names if unusable.get(name) == MISSING]
        broken = [name for name in names if name in unusable and name not in missing]
        subject = f"Extra {extra}"
        if not extra:
            problems = "; ".join(f"{name}: {unusable[name]}" for name in [*missing, *broken])
            remedy = f"reinstall with pip: {', '.join([*missing, *broken])}"
            finding = problems or f"{len(names)} of {len(names)} present"
            checks.append(_check("Packages", finding, usable=not problems, remedy=remedy))
        elif missing and not broken:
            remedy = f"if you want it: pip install 'vibrident[{extra}]'"
            finding = ", ".join(missing)
            checks.append(Check(subject, finding, "not installed", remedy, vital=False))
        else:
            problems = "; ".join(f"{name}: {unusable[name]}" for name in broken)
            remedy = f"reinstall vibrident[{extra}] with pip"
            usable = not broken
            check = _check(
                subject, problems or "installed", usable=usable, remedy=remedy, vital=False
            )
            checks.append(check)
    return checks


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _plug_ins() -> list[Check]:
    """Check what other packages add; one that cannot be used leaves the rest working."""
    return [
        _check(
            "Plug-in",
            plug_in.line,
            usable=not plug_in.problem,
            remedy=f"correct, update or uninstall {plug_in.package}",
            vital=False,
        )
        for registry in REGISTRIES
        for plug_in in registry.plug_ins()
    ]


def _jax() -> list[Check]:
    versions = {package: _version(package) or "missing" for package in ("jax", "jaxlib")}
    if "missing" in versions.values():
        versions_text = "linear sensors need none"
        return [Check("JAX", versions_text, "not installed", "", vital=False)]
    versions_text = ", ".join(f"{package} {version}" for package, version in versions.items())
    try:
        from vibrident.base import backend  # refuses to load where the arithmetic is wrong
    except InputError as error:
        return [Check("JAX", f"{error.problem} {error.found}", "cannot be used", error.remedy)]
    except Exception as error:  # a native library may fail in any way
        remedy = "reinstall vibrident[network] with pip"
        return [Check("JAX", f"{type(error).__name__}: {error}", "cannot be used", remedy)]
    install = f"pip install 'jax=={backend.TRUSTED}' 'jaxlib=={backend.TRUSTED}'"
    error = backend.arithmetic_error()
    right = error < backend.MAX_ARITHMETIC_ERROR
    wide = backend.jnp.asarray(1.0).dtype == "float64"
    device = backend.jax.devices()[0]
    return [
        Check("JAX", f"{versions_text}, on {device.platform}"),
        _check(
            "Sum of matrix products", f"relative error {error:.1e}", usable=right, remedy=install
        ),
        _check(
            "Precision",
            "float64" if wide else "float32",
            usable=wide,
            remedy="unset JAX_ENABLE_X64",
        ),
    ]


def _cache() -> list[Check]:
    if _jax()[0].verdict != "ok":
        return []  # it was said already
    from vibrident.base.backend import cache_folder

    folder = cache_folder()
    if folder is None:
        hint = "unset VIBRIDENT_CACHE: repeated runs start faster"
        return [Check("Kernel cache", "switched off", "ok", hint)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        remedy = (
            "set VIBRIDENT_CACHE to a folder that can be written; without it every run "
            "compiles anew"
        )
        problem = f"{folder}: {error.strerror or error}"
        return [Check("Kernel cache", problem, "cannot be used", remedy)]
    kernels = sum(1 for _ in os.scandir(folder))
    return [Check("Kernel cache", f"{folder}, {kernels} files")]


def _store() -> list[Check]:
    """Open the store of the history, where there is one; else see whether it could be begun."""
    if _version("sqlalchemy") is None or _version("alembic") is None:
        return []  # the extra says so
    try:
        from vibrident.lab.history.store import Store

        with Store() as store:
            if store.revision() is None:
                return [_judge_folder(store.printed)]
            with store.reading():
                return [Check("History", store.printed)]
    except InputError as error:
        problem = f"{error.where}: {error.problem} {error.found}"
        return [Check("History", problem, "cannot be used", error.remedy, vital=False)]
    except Exception as error:  # the driver of a database may fail in any way
        problem = f"{type(error).__name__}: {error}"
        remedy = "check VIBRIDENT_STORE"
        return [Check("History", problem, "cannot be used", remedy, vital=False)]


def _judge_folder(path: str) -> Check:
    """Judge the folder of a store that is not there yet."""
    folder = next(parent for parent in Path(path).absolute().parents if parent.exists())
    return _check(
        "History",
        f"none yet; it would be {path}",
        usable=folder.is_dir() and os.access(folder, os.W_OK),
        remedy="name a store in a folder that can be written",
        vital=False,
    )


def _identification() -> list[Check]:
    """Identify a simulated sensor by network and by maximum likelihood; compare with the truth."""
    from vibrident.fit.estimators import AUTO, ranked
    from vibrident.physics.simulation import SENSORS, simulate
    from vibrident.use.comparison import deviations
    from vibrident.use.identification import identify

    frequencies = (100.0, 300.0, 500.0, 630.0, 800.0)
    calibration = simulate(
        "paper",
        frequencies_hz=frequencies,
        sampling_rate_hz=12800.0,
        samples=2000,
        response_noise=0.01,
        seed=7,
    )
    checks = []
    for estimator in (
        AUTO,
        *(candidate.name for candidate in ranked() if candidate.trains_network),
    ):
        begin = time.perf_counter()
        result = identify(calibration, estimator=estimator)
        elapsed = time.perf_counter() - begin
        off = deviations(result, SENSORS["paper"].parameters)
        far, name = max(
            (float("inf") if d.in_u is None else abs(d.in_u), name) for name, d in off.items()
        )
        deviation = (
            f"at most {far:.1f} u from the truth ({name.replace('_', ' ')}), {elapsed:.1f} s"
        )
        remedy = "reinstall vibrident; if it stays, report it as a bug"
        subject = f"Identification, {result.estimator}"
        checks.append(_check(subject, deviation, usable=far < MAX_DEVIATION_U, remedy=remedy))
    return checks
