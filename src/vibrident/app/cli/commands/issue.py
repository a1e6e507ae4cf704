"""``vibrident issue``: review a draft certificate by a second account, number and sign it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from vibrident.app.cli.console import print_line, show, show_written
from vibrident.app.cli.history_options import open_store
from vibrident.app.cli.options import CERTIFICATE_FILES, RESULT_FILE, argument, flag, option
from vibrident.app.workflow.folder import load_result, written_whole

if TYPE_CHECKING:
    from vibrident.lab.issue.documents import Documents

issue = typer.Typer(
    no_args_is_help=True,
    help="Hand in, review, number and sign certificates: a draft and a second account.",
)

_STORE = option(
    "--store",
    "URL",
    "History that holds drafts and certificates; see `vibrident history`.",
    default="VIBRIDENT_STORE, else a file in the user's data folder",
)
_DRAFT = argument("ID", "Number of the draft.")
_BY = option("--by", "NAME", "Name of the person who acts.", default="the account")
_FOLDER = option("--out", "DIR", "Folder for the files.", Path(), "the current one")


@issue.command("draft")
def hand_in(
    result: Path = RESULT_FILE,
    certificate: list[Path] | None = CERTIFICATE_FILES,
    store: str | None = _STORE,
    by: str | None = _BY,
) -> None:
    """Hand in a draft: a result with all that its certificate states but number and date of \
issue."""
    from vibrident.lab.issue import drafts
    from vibrident.show.issue import issued

    certified, belongings = issued(load_result(result), certificate or [])
    with open_store(store) as opened:
        number = drafts.hand_in(opened, certified, belongings, by=by)
    unused = [key for key in drafts.DRAWN if certified.certificate.get(key)]
    print_line(f"Draft {number} waits for a review by another account.")
    if unused:
        print_line(f"Its {' and '.join(unused)} are not used: issuing gives number and date.")


@issue.command("review")
def review(
    number: int = _DRAFT,
    returned: bool = flag("--return", help="Return it to its author, who hands in another."),
    note: str = option("--note", "TEXT", "What was found.", ""),
    store: str | None = _STORE,
    by: str | None = _BY,
) -> None:
    """Accept a draft that another account handed in, or return it."""
    from vibrident.lab.issue import drafts

    with open_store(store) as opened:
        drafts.review_draft(opened, number, accepted=not returned, by=by, note=note)
    print_line(f"Draft {number} is {'returned' if returned else 'reviewed: it can be issued'}.")


@issue.command("sign")
def sign(
    number: int = _DRAFT,
    key: Path = option("--key", "KEY.p12", "The laboratory's key, PKCS#12.", ..., False),
    passphrase_file: Path | None = option(
        "--passphrase-file", "FILE", "Pass phrase of the key.", default="VIBRIDENT_KEY_PASSPHRASE"
    ),
    folder: Path = _FOLDER,
    store: str | None = _STORE,
    by: str | None = _BY,
) -> None:
    """Issue a reviewed draft: number, PDF/A, DCC and result.json, all signed, and lock it."""
    from vibrident.lab.issue.issuing import issue_draft
    from vibrident.lab.issue.keys import load_key, passphrase

    signing_key = load_key(key, passphrase(passphrase_file))
    with open_store(store) as opened:
        numbered, documents = issue_draft(opened, number, signing_key, by=by)
    print_line(f"Draft {number} is certificate {numbered.number} of {numbered.date}.")
    _write(documents, folder)


@issue.command("files")
def files(number: int = _DRAFT, folder: Path = _FOLDER, store: str | None = _STORE) -> None:
    """Write the files of an issued certificate again, or a draft as PDF for its reviewer."""
    from vibrident.lab.issue.documents import draft_pdf
    from vibrident.lab.issue.drafts import content
    from vibrident.lab.issue.issuing import issued_documents

    with open_store(store) as opened:
        issued = issued_documents(opened, number)
        if issued is not None:
            _write(issued[1], folder)
            return
        pdf = draft_pdf(content(opened, number))
    with written_whole(folder) as output:
        (output.path / f"draft-{number}.pdf").write_bytes(pdf)
    show_written(output.files)


@issue.command("list")
def list_drafts(store: str | None = _STORE) -> None:
    """List drafts and certificates, the newest first."""
    from vibrident.lab.issue.drafts import drafts
    from vibrident.lab.issue.tables import listed

    with open_store(store) as opened:
        show(listed(drafts(opened)))


def _write(documents: Documents, folder: Path) -> None:
    from vibrident.lab.issue.documents import stem

    with written_whole(folder) as output:
        documents.write(output.path, stem(documents.certified))
    show_written(output.files)
