"""Check that a certificate is as its laboratory signed it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vibrident.lab.issue.verification import Signed


def verify(
    file: str | os.PathLike[str], *, trusted: str | os.PathLike[str] | None = None
) -> Signed:
    """Verify the signature of a certificate (extra ``sign``).

    Args:
        file: PDF, DCC (XML), or a file with a detached signature beside it, ``FILE.p7s``; or that
            signature, for the file.
        trusted: PEM or DER file with the certificates to trust; None: a signature of anybody.

    Returns:
        The signer, the time by the signer's clock, the SHA-256 of the signer's certificate, and
        whether it is trusted.

    Raises:
        InputError: the file is unsigned, was changed after signing, is signed by somebody else, or
            cannot be read.

    Examples:
        >>> from pathlib import Path
        >>> import vibrident
        >>> characters = Path("certificate.txt").write_text("sensitivity 0.104")
        >>> try:
        ...     vibrident.verify("certificate.txt")
        ... except vibrident.InputError as error:
        ...     print(error.problem)
        The file is not signed.
    """
    from vibrident.lab.issue.verification import verify as verified

    return verified(Path(file), None if trusted is None else Path(trusted))
