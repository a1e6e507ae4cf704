"""A name that is withdrawn warns the line that uses it, and works."""

import pytest

from vibrident.base.withdrawal import warn_withdrawn


def old_name():
    warn_withdrawn("vibrident.old_name", removed_in="1.2", instead="vibrident.new_name")
    return 7


def test_the_caller_is_warned_with_version_and_remedy():
    with pytest.warns(
        DeprecationWarning, match=r"old_name.*removed in vibrident 1\.2: use vibrident\.new_name"
    ) as said:
        assert old_name() == 7
    assert said[0].filename == __file__
