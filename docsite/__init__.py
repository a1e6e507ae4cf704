"""Pages of the documentation that are made from the code: ``python -m docsite``.

So they cannot go stale.
"""
