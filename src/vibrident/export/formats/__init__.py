"""One format a file; each holds a :class:`vibrident.export.form.Format` in the file's name."""
