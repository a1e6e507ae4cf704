"""Long records of steady motion, identified a stretch at a time, on one machine or many.

``stretch`` fits one of them, ``store`` keeps what was fitted, ``pooled`` sums them up, and
``identification`` is the way from records to result.
"""
