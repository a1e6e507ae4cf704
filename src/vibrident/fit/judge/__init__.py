"""Verdict on a fit: adequacy, warnings, remedies, and the document that states them.

``attempts`` fits and judges, once more from elsewhere where nothing is explained; ``refits`` do so
with other data; ``adequacy`` is the verdict, with the stated systematic ``effects``; ``remedy``
names the model that explains what this one does not; ``examined`` states what departs from the fit;
``doubts`` gives the warnings that need a fitted model; ``measured`` sets the data beside it;
``document`` makes the result.
"""
