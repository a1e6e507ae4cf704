"""Data formats; each file holds a :class:`vibrident.data.io.reader.Reader` in its name.

Opening and loading raise as ``Reader.open`` and :class:`vibrident.data.io.columns.ColumnFile`
state: InputError where the file is damaged or not of the format, holds no numbers, or its library
is not installed.
"""
