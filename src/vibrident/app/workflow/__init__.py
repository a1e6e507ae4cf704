"""What shell and page have in common: settings made ready, an identification run, files written whole."""
