"""Hold the commands of the shell, one a file."""
