"""Provide what shell and page have in common: settings, identification, whole files."""
