"""The command line, the page, and what they share; no arithmetic.

What cannot be used is refused with an ``InputError`` wherever it is met; the command line and the
page show it.
"""
