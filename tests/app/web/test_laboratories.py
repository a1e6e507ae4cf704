"""A laboratory's profile is kept whole, in the keys of the files it fills in."""

from __future__ import annotations

import math

import pytest

from vibrident.app.web.form.entries import filled
from vibrident.app.web.laboratories import Laboratories
from vibrident.base.errors import InputError
from vibrident.data.effects import SystematicEffect
from vibrident.data.io.certificate import CertificateSection
from vibrident.data.io.keys import keys_of
from vibrident.data.io.laboratory import LABORATORY_KEYS
from vibrident.data.io.sections import CapabilityEntry, UncertaintyEntry

DOCUMENT = {
    "certificate": {
        "laboratory": "Labor für Schwingung",
        "instruments": [{"name": "Laser", "calibrated_until": "2027-01-31"}],
    },
    "uncertainty": [{"source": "Laser", "kind": "gain", "standard_uncertainty": 0.002, "from_hz": 5.0}],
    "cmc": [{"expanded_uncertainty": 0.005}],
}


def test_what_was_written_is_read_and_a_refused_change_leaves_it(tmp_path):
    laboratories = Laboratories(tmp_path / "laboratories")
    assert laboratories.names == []
    assert laboratories.write(" Halle  2, links ", DOCUMENT, {"logo": b"<svg/>"}) == "Halle 2, links"
    assert laboratories.read("Halle 2, links") == DOCUMENT
    assert laboratories.file_content("Halle 2, links", "logo") == b"<svg/>"
    wrong = {**DOCUMENT, "uncertainty": [{"source": "Laser", "kind": "gain"}]}
    with pytest.raises(InputError, match="one size"):
        laboratories.write("Halle 2, links", wrong, {})
    assert laboratories.read("Halle 2, links") == DOCUMENT
    assert sorted(path.name for path in laboratories.folder.iterdir()) == [
        "Halle 2, links.logo",
        "Halle 2, links.toml",
    ]
    laboratories.remove("Halle 2, links")
    assert list(laboratories.folder.iterdir()) == []
    assert laboratories.read("Halle 2, links")["certificate"] == {}


@pytest.mark.parametrize("name", ["", "../a", "a/b", ".a", "a\\b", "a\x00", "a" * 81, "a."])
def test_a_name_that_leads_elsewhere_is_refused(tmp_path, name):
    laboratories = Laboratories(tmp_path / "laboratories")
    with pytest.raises(InputError, match="name of the profile"):
        laboratories.write(name, DOCUMENT, {})
    assert not laboratories.folder.exists()


def test_a_profile_states_keys_of_a_certificate():
    assert set(LABORATORY_KEYS) <= set(CertificateSection.model_fields)


def test_a_source_is_asked_for_in_the_unit_of_its_kind_and_stated_in_that_of_the_file():
    """By the effect's own unit: %, ppm of a relative one, µs of s, ° of rad."""
    key = keys_of(UncertaintyEntry)["standard_uncertainty"]
    in_si = {"%": 0.01, "ppm": 1e-6, "µs": 1e-6, "°": math.pi / 180}
    for kind in keys_of(UncertaintyEntry)["kind"].options:
        if kind is None:
            continue
        unit, _ = asked = key.asked_in({"kind": kind})
        assert filled(key, 0.7, asked) == pytest.approx(0.7 * in_si[unit], rel=1e-12)
        of_file = SystematicEffect("", kind, 1.0).unit
        assert {"µs": "s", "°": "rad"}.get(unit, "1") == of_file
    assert filled(key, 0.7, key.asked_in({"kind": "gain"})) == 0.007
    least = keys_of(CapabilityEntry)["expanded_uncertainty"]
    assert least.asked_in({"quantity": "phase"})[0] == "°"


def test_what_a_kind_does_not_have_is_not_asked_for():
    keys = keys_of(UncertaintyEntry)
    asked = {
        kind: {name for name in keys if keys[name].applies({"kind": kind})} for kind in ("gain", "mounting", "clock")
    }
    assert {"from_hz", "to_hz"} <= asked["gain"]
    assert "frequency_hz" not in asked["gain"]
    assert "frequency_hz" in asked["mounting"]
    assert not {"from_hz", "to_hz", "frequency_hz"} & asked["clock"]
