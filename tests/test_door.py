"""The public door: the names of ``vibrident``, each of which a stranger may use."""

from __future__ import annotations

import sys

import pytest

import vibrident


def test_each_public_name_is_there():
    assert sorted(dir(vibrident)) == sorted(vibrident.__all__)
    assert all(getattr(vibrident, name) is not None for name in vibrident.__all__)


def test_a_function_is_not_hidden_by_the_room_of_its_name():
    assert "vibrident.export" in sys.modules
    import vibrident.export.registry

    assert callable(vibrident.export)


def test_an_unknown_name_is_no_attribute():
    with pytest.raises(AttributeError, match="no_such_name"):
        vibrident.no_such_name  # noqa: B018
