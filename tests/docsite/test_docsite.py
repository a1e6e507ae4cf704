"""The documentation's pages are there, and what is made from the code is complete."""

import re
from collections.abc import Iterator

import nbformat
import pytest
import yaml
from docsite.api import api
from docsite.calibration_file import calibration_file
from docsite.commands import commands
from docsite.excitations import excitations
from docsite.first_steps import first_steps
from docsite.gallery import SHOTS
from docsite.hooks import linked
from docsite.made import MADE_PAGES, PAGE_MAKERS
from docsite.models import models
from tests.support.sources import ROOT

import vibrident
from docsite import executed, warnings
from vibrident.base.warning_kinds import WARNINGS
from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.physics.models import ADD_ONS, CORES


def pages(nav) -> Iterator[str]:
    for entry in nav:
        for value in entry.values():
            yield from [value] if isinstance(value, str) else pages(value)


@pytest.fixture(scope="module")
def nav() -> list[str]:
    return [*pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"])]


def test_every_page_of_the_menu_is_written_or_made(nav):
    assert [page for page in nav if page not in MADE_PAGES and not (ROOT / "docs" / page).is_file()] == []
    assert len(nav) == len(set(nav))


def test_every_page_is_in_the_menu(nav):
    written = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert {page for page in written | set(MADE_PAGES) if not page.startswith("studies/")} == set(nav)


def test_made_pages_are_not_in_git():
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").split()
    for page in MADE_PAGES:
        assert f"/docs/{page}" in ignored or f"/docs/{page.split('/')[0]}/" in ignored


def test_the_page_of_commands_lists_every_command_with_every_option():
    import typer.main

    from vibrident.app.cli.application import app

    page = commands()
    sections = dict(re.findall(r"^## (\S+)\n(.*?)(?=^## |\Z)", page, flags=re.MULTILINE | re.DOTALL))
    group = typer.main.get_command(app)
    assert sections.keys() == group.commands.keys()
    for name, command in group.commands.items():
        for parameter in command.params:
            if parameter.param_type_name == "option" and not parameter.hidden:
                assert f"`{parameter.opts[0]}" in sections[name] or f" {parameter.opts[0]}" in sections[name], name
        assert command.help.split(".")[0][:30] in sections[name].replace("\\", "")


def test_the_page_of_the_interface_has_every_public_name():
    page = api()
    for name in set(vibrident.__all__) - {"__version__"}:
        assert re.search(rf"^(::: vibrident\.\S*\b|      heading: ){name}$", page, flags=re.MULTILINE), name


def test_the_page_of_models_has_every_model_and_parameter():
    page = models()
    for name, part in {**CORES, **ADD_ONS}.items():
        assert f"`{name}`" in page
        assert all(f"`{spec.name}`" in page for spec in part.parameters)


def test_the_page_of_the_calibration_file_says_what_each_key_takes():
    page = calibration_file()
    for section in CalibrationFile.model_fields:
        assert re.search(rf"^### \[+{section}\]+$", page, flags=re.MULTILINE), section
    rows = [line.split(" | ") for line in page.splitlines() if line.startswith("| `")]
    assert len(rows) > 40
    assert [row for row in rows if not (row[1].strip(". ") and row[3].strip())] == []


@pytest.mark.parametrize("name", PAGE_MAKERS)
def test_links_between_pages_lead_somewhere(name, nav):
    for target in re.findall(r"\]\(([^)#:]+\.md)(?:#[^)]*)?\)", PAGE_MAKERS[name]()):
        study = target.startswith("../studies/") and (ROOT / "docs" / target).is_file()
        assert target in nav or study


def test_links_of_written_pages_stay_within_the_site():
    text = "*a*<!-- api.md#read --> [b](../studies/bench.md) [c](guide.md)"
    assert linked(text, "") == "[a](api.md#read) [b](studies/bench.md) [c](guide.md)"
    assert linked(text, "warnings") == "[a](../api.md#read) [b](../studies/bench.md) [c](guide.md)"


def test_first_steps_end_where_the_work_on_the_code_begins():
    page = first_steps()
    assert page.startswith("# vibrident\n")
    assert "make lint" not in page
    assert "## Quick start" in page


def test_the_command_on_the_page_of_motions_prints_a_row_of_its_table():
    from typer.testing import CliRunner

    from vibrident.app.cli import app

    page = excitations()
    command = re.search(r"^    vibrident (plan .*?)\n\n", page, flags=re.MULTILINE | re.DOTALL)
    done = CliRunner().invoke(app, command[1].replace("\\\n", " ").split(), catch_exceptions=False)
    assert done.exit_code == 0
    row = next(line for line in page.splitlines() if line.startswith("| sines to a third of fn"))
    said = re.findall(r"[\d.]+ %", row)
    assert len(said) == 3
    assert all(f" {number} " in done.output for number in said), (said, done.output)


def test_every_command_of_the_gallery_exists():
    import typer.main

    from vibrident.app.cli.application import app

    assert {shot.command.split()[0] for shot in SHOTS} <= typer.main.get_command(app).commands.keys()


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "story.py"
    path.write_text("""# %% [markdown]
# # A story
#
# See [the guide](guide.md#limits).

# %%
import matplotlib.pyplot as plt

print("said")
figure, axis = plt.subplots()
axis.set_title("A line")
6 * 7

# %% [check]
assert figure is not None
print("not shown")
""")
    return path


def test_a_program_is_a_page_and_a_notebook_by_one_run(program, tmp_path):
    cells = executed.run(program)
    page = executed.page(cells, tmp_path, "story")
    assert page.startswith("# A story\n\n*[This page as a Jupyter notebook](story.ipynb)*")
    assert "(../guide.md#limits)" in page
    assert "```text\nsaid\n```" in page
    assert "```text\n42\n```" in page
    assert "![A line](story-1.png)" in page
    assert (tmp_path / "story-1.png").read_bytes().startswith(b"\x89PNG")
    assert "not shown" not in page
    made = nbformat.reads(executed.notebook(cells), as_version=4)
    nbformat.validate(made)
    assert [cell.cell_type for cell in made.cells] == ["markdown", "code"]
    assert "(../guide.html#limits)" in made.cells[0].source
    assert [output.output_type for output in made.cells[1].outputs] == ["stream", "execute_result", "display_data"]


def test_a_story_that_is_no_longer_true_ends_the_build(program):
    program.write_text(program.read_text().replace("is not None", "is None"))
    with pytest.raises(AssertionError):
        executed.run(program)


@pytest.mark.parametrize("code", WARNINGS)
def test_every_warning_has_causes_and_an_example(code):
    """``make docs`` runs the example and looks for the code in what it prints."""
    causes, example, _ = warnings.program(code)
    assert "## Causes" in causes
    assert "## Example" in causes
    assert "warning.code" in example
    compile(example, code, "exec")


def test_the_page_of_a_warning_shows_what_the_example_printed(tmp_path):
    page = warnings.page("aliasing", tmp_path)
    assert page.startswith("# `aliasing`\n\n")
    assert "## What to do" in page
    assert re.search(r"```text\naliasing: random: 8 % of the reference's power", page)
    assert "ipynb" not in page


def test_a_warning_that_an_example_does_not_give_ends_the_build(tmp_path, monkeypatch):
    monkeypatch.setattr(warnings, "program", lambda code: ("## Causes", "print('nothing')\n", ""))
    with pytest.raises(ValueError, match="expected to print this code"):
        warnings.page("drift", tmp_path)
