"""Check and run an identification as requested by a shell or a page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.estimators import AUTO, check_settings, estimator
from vibrident.base.errors import InputError
from vibrident.base.fields import GivenFields

if TYPE_CHECKING:
    from vibrident.data.io.long_records import LongRecords
    from vibrident.data.records import Calibration
    from vibrident.fit.optimise import Progress
    from vibrident.result import Result


@dataclass(frozen=True)
class IdentifyRequest:
    """Choices of an identification."""

    estimator: str = AUTO  # its name, or ``auto``
    # setting of the estimator → its value, None where it is not given
    settings: GivenFields = field(default_factory=dict)
    # name of the sensor model: one for all calibrations, or one each; None: the calibrations' own
    models: Sequence[str] | None = None
    uncertainty: Any = "auto"  # what the uncertainties cover
    # parameters that several calibrations share; None: by what the parameters describe
    share: Sequence[str] | None = None
    posterior: bool = False  # whether the posterior is sampled
    band_hz: tuple[float, float] | None = None  # of the fit; None: as the calibrations state
    weights: bool = False  # whether the weights of a network are requested
    scheduler: str | None = None  # Dask scheduler whose workers share long records
    work: Path | None = None  # folder that keeps the fits of stretches of long records

    def check(self, calibrations: int = 1) -> None:
        """Refuse options that exclude each other; nothing is read."""
        check_settings(self.estimator, self.settings, weights=self.weights)
        if calibrations == 1 and self.share:
            raise several_files_error(
                "⟦identify.share⟧", f"⟦identify.share = {list(self.share)!r}⟧"
            )
        if calibrations > 1 and self.posterior:
            raise InputError(
                "The posterior is sampled for one calibration at a time.",
                expected="one calibration file with ⟦identify.posterior⟧",
                found=f"{calibrations} files",
                where="⟦here⟧",
                remedy="leave ⟦identify.posterior⟧ out, or identify each file by itself",
            )
        if calibrations > 1 and (self.scheduler is not None or self.work is not None):
            raise InputError(
                "Long records are shared of one calibration at a time.",
                expected="one calibration file with ⟦identify.scheduler⟧ or ⟦identify.work⟧",
                found=f"{calibrations} files",
                where="⟦here⟧",
                remedy="leave it out, or identify each file by itself",
            )


def run(
    request: IdentifyRequest,
    calibrations: Sequence[Calibration | LongRecords],
    progress: Progress,
) -> list[Result]:
    """Return a result for each calibration; several make one joint fit.

    Raises:
        InputError: the data cannot be used, or there are more models than calibrations.
        ModelError: model, estimator and data do not fit together.
        NotConverged: no start leads to a finite fit.
    """
    method = estimator(request.estimator, request.settings)
    models = request.models
    if len(calibrations) == 1:
        if models is not None and len(models) > 1:
            raise several_files_error(
                "⟦identify.model = [A, B]⟧", f"⟦identify.model = {list(models)!r}⟧"
            )
        model = None if models is None else models[0]
        return [_identify_alone(request, calibrations[0], model, method, progress)]
    from vibrident.data.records import Calibration
    from vibrident.fit.joint import identify_together

    in_memory = [
        calibration if isinstance(calibration, Calibration) else calibration.in_memory()
        for calibration in calibrations
    ]
    results = identify_together(
        [calibration.within(request.band_hz) for calibration in in_memory],
        models[0] if models is not None and len(models) == 1 else models,
        method,
        share=request.share,
        uncertainty=request.uncertainty,
        progress=progress,
    )
    return list(results)


def _identify_alone(
    request: IdentifyRequest,
    calibration: Calibration | LongRecords,
    model: str | None,
    method: Any,
    progress: Progress,
) -> Result:
    from vibrident.use.identification import identify

    sampling = None
    if request.posterior:
        from vibrident.fit.uncertainty.posterior import Sampling

        sampling = Sampling()
    return identify(
        calibration,
        model,
        method,
        band_hz=request.band_hz,
        uncertainty=request.uncertainty,
        posterior=sampling,
        scheduler=request.scheduler,
        work=request.work,
        progress=progress,
    )


def several_files_error(option: str, actual: str) -> InputError:
    """Return the error of an option that is for several calibrations."""
    return InputError(
        f"The option {option} is for several calibrations.",
        expected=f"two or more calibration files with {option}",
        found=f"{actual} with one",
        where="⟦here⟧",
        remedy=f"name the other calibrations of this sensor, or leave {option} out",
    )


def result_folders(files: Sequence[Path], folder: Path) -> list[Path]:
    """Return the folder of each result: the first in ``folder``, others below it by their names."""
    folders = [folder]
    for file in files[1:]:
        candidate = folder / file.stem
        number = 2
        while candidate in folders:
            candidate = folder / f"{file.stem}-{number}"
            number += 1
        folders.append(candidate)
    return folders
