"""Alembic's migrations of the store, one file a revision; run by ``history upgrade`` and for a new store."""
