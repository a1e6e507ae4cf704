"""From a draft to a certificate: two accounts, a number of its own, nothing lost, nothing changed."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
import sqlalchemy as sa
from tests.support.lives import calibrated, certifiable
from tests.support.signing import PHRASE, key_file

from vibrident.base.errors import InputError
from vibrident.lab.history import query
from vibrident.lab.history.store import Store
from vibrident.lab.issue.documents import draft_pdf, stem
from vibrident.lab.issue.drafts import content, drafts, hand_in, review_draft
from vibrident.lab.issue.issuing import issue_draft
from vibrident.lab.issue.keys import load_key, passphrase
from vibrident.show.issue import NOTHING_MORE

pytestmark = pytest.mark.usefixtures("unpainted")


@pytest.fixture
def store(tmp_path):
    with Store(str(tmp_path / "h.db")) as opened:
        yield opened


@pytest.fixture(scope="module")
def key(tmp_path_factory):
    return load_key(key_file(tmp_path_factory.mktemp("key")), PHRASE)


def reviewed(store, result, by="alice", reviewer="bob") -> int:
    number = hand_in(store, result, NOTHING_MORE, by=by)
    review_draft(store, number, accepted=True, by=reviewer)
    return number


def test_a_draft_is_issued_once_it_is_reviewed_by_another(store, key):
    number = hand_in(store, certifiable(), NOTHING_MORE, by="alice")
    with pytest.raises(InputError, match="Only a reviewed draft"):
        issue_draft(store, number, key)
    for author in ("alice", " Alice ", ""):
        with pytest.raises(InputError, match="of their own"):
            review_draft(store, number, accepted=True, by=author)
    review_draft(store, number, accepted=False, by="bob", note="The place is wrong.")
    with pytest.raises(InputError, match="returned by bob: The place is wrong"):
        issue_draft(store, number, key)
    with pytest.raises(InputError, match="returned draft is not reviewed again"):
        review_draft(store, number, accepted=True, by="bob")
    number = hand_in(store, certifiable(), NOTHING_MORE, by="alice")
    review_draft(store, number, accepted=True, by="bob")
    known, documents = issue_draft(store, number, key, by="carol")
    assert (known.state, known.author, known.reviewer, known.issuer) == ("issued", "alice", "bob", "carol")
    stated = documents.certified.certificate
    assert known.number == f"{known.date.year}-0001"
    assert (stated["number"], stated["date_of_issue"]) == (known.number, str(known.date))
    assert stated["approved_by"] == "bob"
    assert known.number in documents.dcc.decode()
    (row,) = query.rows(store)
    assert (row["certificate_number"], row["standing"]) == (known.number, "approved")


def test_an_issued_certificate_stays_as_it_is(store, key):
    number = reviewed(store, certifiable())
    known, documents = issue_draft(store, number, key)
    again, same = issue_draft(store, number, key)
    assert (again, same) == (known, documents)
    with pytest.raises(InputError, match="cannot be changed"):
        review_draft(store, number, accepted=False, by="bob")
    for table in ("draft", "review", "certificate_number", "certificate"):
        for order in (f"DELETE FROM {table}", f"UPDATE {table} SET recorded = ''"):
            with pytest.raises(InputError, match="cannot be changed"), store.writing() as connection:
                connection.execute(sa.text(order))
    with store.writing() as connection:
        connection.execute(
            sa.text("INSERT OR REPLACE INTO certificate SELECT draft_id, 'x', '', x'', x'', x'', x'' FROM certificate")
        )
    assert issue_draft(store, number, key) == (known, documents)


def test_a_correction_replaces_the_certificate(store, key):
    first, _ = issue_draft(store, reviewed(store, certifiable()), key)
    with pytest.raises(InputError, match="have a certificate already"):
        issue_draft(store, reviewed(store, certifiable(place="customer")), key)
    other = certifiable("two", "4712", replaces=first.number, changes=["x"])
    with pytest.raises(InputError, match="of another sensor"):
        issue_draft(store, reviewed(store, other), key)
    with pytest.raises(InputError, match="changes"):
        hand_in(store, certifiable(replaces=first.number), NOTHING_MORE)
    corrected = certifiable(replaces=first.number, changes=["The place."], place="customer")
    second, documents = issue_draft(store, reviewed(store, corrected), key)
    assert second.number.endswith("-0002")
    assert stem(documents.certified) == f"certificate-{second.number}-4711-2020-01-01"
    assert first.number in documents.dcc.decode()
    late = certifiable(replaces=first.number, changes=["The customer."], customer="D")
    with pytest.raises(InputError, match=f"that {second.number} replaced"):
        issue_draft(store, reviewed(store, late), key)
    sensor = query.find(store, "4711")
    standing = [str(each) for each in query.entries(store, sensor.id)[sensor.id]]
    assert sum("approved" in each for each in standing) == 1
    assert [each.number for each in drafts(store) if each.number] == [second.number, first.number]


def test_issuers_at_once_draw_a_number_each_and_leave_no_gap(store, key):
    numbers = [reviewed(store, certifiable(f"data {i}", f"S{i}")) for i in range(3)]

    def issue(number: int) -> str:
        with Store(store.url) as own:
            return issue_draft(own, number, key)[0].number

    with ThreadPoolExecutor(4) as threads:
        drawn = list(threads.map(issue, [*numbers, numbers[0]]))
    assert drawn[0] == drawn[-1]
    assert sorted(int(number.split("-")[1]) for number in drawn[:-1]) == [1, 2, 3]


def test_a_number_that_a_calibration_states_already_is_not_drawn(store, key):
    year = time.gmtime().tm_year
    from tests.support.databases import add

    add(store.url, [certifiable("old", "old", number=f"{year}-0001")])
    known, _ = issue_draft(store, reviewed(store, certifiable()), key)
    assert known.number == f"{year}-0002"


KILLED = """
import os, signal, sys
from vibrident.lab.history.store import Store
from vibrident.lab.issue import issuing
from vibrident.lab.issue.keys import load_key
from pathlib import Path
def killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)
issuing.signed_documents = killed
with Store(sys.argv[1]) as store:
    issuing.issue_draft(store, int(sys.argv[2]), load_key(Path(sys.argv[3]), sys.argv[4]))
"""


def test_a_kill_between_number_and_signature_loses_nothing(store, key, tmp_path):
    first = reviewed(store, certifiable())
    second = reviewed(store, certifiable("two", "4712"))
    file = key_file(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", KILLED, store.url, str(first), str(file), PHRASE], check=False, timeout=120
    )
    assert done.returncode == -signal.SIGKILL
    (left,) = [each for each in drafts(store) if each.number]
    assert (left.id, left.state) == (first, "reviewed")
    assert issue_draft(store, second, key)[0].number.endswith("-0002")
    assert issue_draft(store, first, key)[0].number == left.number


def test_what_lacks_or_is_no_calibration_is_no_draft(store):
    with pytest.raises(InputError, match="customer"):
        hand_in(store, certifiable(customer=""), NOTHING_MORE)
    scatter = replace(certifiable(), uncertainty={"covers": ["noise"]})
    with pytest.raises(InputError, match="cannot be certified"):
        hand_in(store, scatter, NOTHING_MORE)
    late = certifiable(date_of_receipt="2030-01-01")
    with pytest.raises(InputError, match="contradict"):
        hand_in(store, late, NOTHING_MORE)


def test_a_draft_keeps_what_its_certificate_needs(store, tmp_path):
    template = tmp_path / "own.typ"
    template.write_text("#let doc = json(bytes(sys.inputs.document))\nOwn #doc.draft")
    issue = replace(NOTHING_MORE, before=calibrated(0.11), template=template, fonts=(tmp_path,))
    number = hand_in(store, certifiable(number="7", date_of_issue="2030-01-01"), issue, by="alice")
    template.unlink()
    held = content(store, number)
    assert held.issue.before == calibrated(0.11)
    assert held.issue.fonts == (tmp_path,)
    assert not {"number", "date_of_issue"} & set(held.result.certificate)
    assert draft_pdf(held).startswith(b"%PDF")


def test_the_pass_phrase_is_in_a_file_or_the_environment(tmp_path, monkeypatch):
    monkeypatch.delenv("VIBRIDENT_KEY_PASSPHRASE", raising=False)
    with pytest.raises(InputError, match="not given"):
        passphrase(None)
    (tmp_path / "phrase").write_text(f"{PHRASE}\n")
    assert passphrase(tmp_path / "phrase") == PHRASE
    monkeypatch.setenv("VIBRIDENT_KEY_PASSPHRASE", "other")
    assert passphrase(None) == "other"
    key = load_key(key_file(tmp_path), PHRASE)
    assert "PRIVATE" not in repr(key)
    for file, phrase in ((tmp_path / "key.p12", "wrong"), (tmp_path / "key.pem", PHRASE), (tmp_path / "none", "")):
        with pytest.raises(InputError, match="cannot be read"):
            load_key(file, phrase)


def test_the_stored_result_is_the_certified_one(store, key):
    _, documents = issue_draft(store, reviewed(store, certifiable()), key)
    kept = json.loads(documents.result)
    assert kept["parameters"] == json.loads(certifiable().to_json())["parameters"]
