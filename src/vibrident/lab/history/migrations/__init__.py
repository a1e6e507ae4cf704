"""Migrations of the store by Alembic, one file a revision, run by ``history upgrade``."""

from __future__ import annotations

from alembic import op

from vibrident.base.fields import NamedTexts


def forbid_changes(same_row: NamedTexts) -> None:
    """Forbid changes of the rows of tables.

    ``same_row``: table → the condition by which a row takes the place of a new one.
    """
    if op.get_bind().dialect.name != "sqlite":
        op.execute(
            "CREATE OR REPLACE FUNCTION vibrident_append_only() RETURNS trigger LANGUAGE plpgsql "
            "AS $$ BEGIN RAISE EXCEPTION 'the history is append-only'; END $$"
        )
        for name in same_row:
            op.execute(
                f"CREATE TRIGGER {name}_append_only BEFORE UPDATE OR DELETE OR TRUNCATE ON {name} "
                "FOR EACH STATEMENT EXECUTE FUNCTION vibrident_append_only()"
            )
        return
    for name, same in same_row.items():
        for action in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER {name}_no_{action.lower()} BEFORE {action} ON {name} "
                f"BEGIN SELECT RAISE(ABORT, 'the history is append-only'); END"
            )
        op.execute(  # INSERT OR REPLACE would remove a row without an error
            f"CREATE TRIGGER {name}_no_replace BEFORE INSERT ON {name} "
            f"WHEN EXISTS (SELECT 1 FROM {name} WHERE {same}) BEGIN SELECT RAISE(IGNORE); END"
        )
