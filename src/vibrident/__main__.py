"""``vibrident``, also as ``python -m vibrident``: the command line and the page."""

from __future__ import annotations

from typing import Any

from vibrident.app import cli


def main() -> None:
    """Run the command line."""
    cli.main(_serve)


def _serve(**options: Any) -> None:
    from vibrident.app.web.server import serve

    serve(**options)


if __name__ == "__main__":
    main()
