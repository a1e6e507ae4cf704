"""Read and change drafts and certificates of the store; each function runs in its own process."""

from __future__ import annotations

import os
from pathlib import Path

from vibrident.base.fields import Fields
from vibrident.data.io.certificate import CertificateData
from vibrident.lab.history.store import Store
from vibrident.lab.issue import drafts, issuing
from vibrident.lab.issue.documents import draft_pdf, stem
from vibrident.lab.issue.keys import load_key
from vibrident.result import Result
from vibrident.show.issue import issued

MAX_DRAFTS_SHOWN = 30  # newest drafts on the page; the others are listed by the command line
#: Form of a document → ending of its file and field of what was issued.
FORMS = {
    "pdf": (".pdf", "pdf"),
    "dcc": (".dcc.xml", "dcc"),
    "json": (".json", "result"),
    "p7s": (".json.p7s", "result_signature"),
}


def list_drafts(store: str) -> list[Fields]:
    """Return the newest drafts, each with its fields; none where there is no store yet."""
    with Store(store) as opened:
        if opened.revision() is None:
            return []
        listed = drafts.drafts(opened)[:MAX_DRAFTS_SHOWN]
    return [
        {**vars(certificate), "date": None if certificate.date is None else str(certificate.date)}
        for certificate in listed
    ]


def hand_in_draft(path: Path, store: str, data: CertificateData, by: str) -> int:
    """Return the number of a new draft of a result, with what is stated for its certificate."""
    _without_network()
    result, issue = issued(Result.load(path), data)
    with Store(store) as opened:
        return drafts.hand_in(opened, result, issue, by=by)


def review_draft(store: str, draft_id: int, by: str, accepted: bool, note: str) -> None:
    """Record the review of an account."""
    with Store(store) as opened:
        drafts.review_draft(opened, draft_id, accepted=accepted, by=by, note=note)


def issue_certificate(store: str, draft_id: int, by: str, key: Path, phrase: str) -> str:
    """Return the number of the certificate that a reviewed draft has become."""
    _without_network()
    with Store(store) as opened:
        return issuing.issue_draft(opened, draft_id, load_key(key, phrase), by=by)[0].number


def read_document(store: str, draft_id: int, form: str) -> tuple[bytes, str]:
    """Return a document of a certificate, or the PDF of a draft, and the name of its file."""
    _without_network()
    with Store(store) as opened:
        stored = issuing.issued_documents(opened, draft_id)
        if stored is None:
            return draft_pdf(drafts.content(opened, draft_id)), f"draft-{draft_id}.pdf"
    documents = stored[1]
    ending, field = FORMS[form]
    return getattr(documents, field), stem(documents.certified) + ending


def _without_network() -> None:
    """Have typst fetch no packages for a laboratory's template: the proxy is nobody's."""
    os.environ["HTTPS_PROXY"] = "http://127.0.0.1:9"
