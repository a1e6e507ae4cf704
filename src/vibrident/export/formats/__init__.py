"""Formats, one a file; each defines a :class:`vibrident.export.form.Format` in the file's name.

Writers raise as ``Format.write`` states: InputError where the format cannot hold the sensor, or
lacks an option or a library.
"""
