"""Migrations of the store by Alembic, one file a revision, run by ``history upgrade``."""
