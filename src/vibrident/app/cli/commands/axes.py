"""``vibrident axes``: the sensitivity matrix of a sensor with several outputs."""

from __future__ import annotations

from pathlib import Path

from vibrident.app.cli import options
from vibrident.app.cli.console import show, show_written
from vibrident.app.cli.options import option
from vibrident.app.workflow.folder import written_whole


def axes(
    calibration: Path = options.CALIBRATION_FILE,
    folder: Path = option(
        "--out", "DIR", "Folder for matrix.json and matrix.md.", Path("vibrident-matrix")
    ),
) -> None:
    """Compute the sensitivity matrix of a sensor with two or three outputs.

    It has the main and transverse sensitivities and the misalignment.

    The calibration file has a [[response]] for each output, with its axis, and either [reference]
    with the axis of the motion in each [[records]] entry, or a [[reference]] for each axis of
    motion.
    """
    from vibrident.show.matrix import element_table, main_table
    from vibrident.show.media.markdown import markdown_table
    from vibrident.use.triaxial import sensitivity_matrix

    matrix = sensitivity_matrix(calibration)
    tables = main_table(matrix), element_table(matrix)
    with written_whole(folder) as output:
        matrix.save(output.path / "matrix.json")
        text = "\n\n".join(markdown_table(table) for table in tables)
        (output.path / "matrix.md").write_text(
            f"# Sensitivity matrix\n\n{text}\n", encoding="utf-8"
        )
    show(tables[0])
    show_written(output.files)
