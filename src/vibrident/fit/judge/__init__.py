"""Verdict on a fit: adequacy, warnings, remedies, and the document that states them.

``attempts`` fits and judges; ``refits`` do so with other data. ``adequacy`` is the verdict, with
the stated systematic ``effects``, by which ``corrections`` correct the records. ``clocks`` brings
two clocks together, and ``between_samples`` fits a reference that is held between samples or joined
by lines. ``remedy`` names a model, and ``reference`` a sensor as the reference, that would explain
a misfit. ``departure_report`` states departures from the fit, ``fit_warnings`` the warnings that
need a fitted model, ``misfit`` the lack of fit. ``measured`` gives the data beside the fit,
``excerpts`` pieces of them for pictures, ``provenance`` their files. ``document`` makes the result.
"""
