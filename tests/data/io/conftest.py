"""What the tests of vibrident.data.io share."""

from collections.abc import Callable

import pytest

from vibrident.base.errors import InputError


@pytest.fixture
def refused() -> Callable[..., InputError]:
    """Call something that must raise InputError; check its four labels and what they must contain."""

    def check(call: Callable[[], object], *, problem="", expected="", found="", where="", remedy="") -> InputError:
        with pytest.raises(InputError) as caught:
            call()
        error = caught.value
        wanted = {"problem": problem, "expected": expected, "found": found, "where": where, "remedy": remedy}
        for label, text in wanted.items():
            assert getattr(error, label), f"{label} is empty in:\n{error}"
            assert text in getattr(error, label), f"{label} lacks {text!r} in:\n{error}"
        return error

    return check
