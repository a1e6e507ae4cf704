"""Gallery of pictures that commands make of simulated data, each under its command."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

_RUN = "from vibrident.app.cli import main; main()"


@dataclass(frozen=True)
class Shot:
    """A command and what its pictures show.

    Attributes:
        command: after ``vibrident``; paths are relative to the folder of the run.
        pictures: path to the caption.
    """

    command: str
    pictures: dict[str, str]


SHOTS = (
    Shot(
        "demo --out demo",
        {
            "demo/sensitivity.png": "The sensitivity over frequency: model and measurement.",
            "demo/deviation.png": "Their difference, in units that show it.",
            "demo/residuals.png": "What the model leaves of the records.",
            "demo/signals.png": "Measured and predicted response in time.",
            "demo/training.png": "The way of the optimiser.",
        },
    ),
    Shot(
        "inspect demo/calibration.toml --out look",
        {"look/inspect.png": "The data before any model."},
    ),
    Shot(
        "plan --from demo/result.json --out plan",
        {"plan/plan.png": "The uncertainty to be expected of a plan."},
    ),
    Shot("simulate --out shock --excitation shock --response-noise 0.001 --seed 1", {}),
    Shot(
        "correct demo/result.json shock/calibration.toml --out corrected",
        {"corrected/correction.png": "The acceleration, restored from the response, with u."},
    ),
)


def write(folder: Path) -> None:
    """Run the commands and put their pictures and a page into the folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    parts = [
        "# Gallery",
        "Made by the commands shown, when this site was built. All data are simulated.",
    ]
    with tempfile.TemporaryDirectory() as temporary:
        for shot in SHOTS:
            subprocess.run(
                [sys.executable, "-c", _RUN, *shot.command.split()],
                cwd=temporary,
                check=True,
                stdout=subprocess.DEVNULL,
            )
            parts.append(f"    vibrident {shot.command}")
            for picture, caption in shot.pictures.items():
                name = picture.replace("/", "-")
                shutil.copy(Path(temporary) / picture, folder / name)
                parts.append(f"![{caption}]({name})\n\n*{caption}*")
    (folder / "index.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
