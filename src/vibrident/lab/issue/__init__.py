"""From a draft certificate to an issued one: review by a second account, number, signatures, verification.

Drafts, reviews and what was issued are rows of the history's store, which only grows. Signing needs
the extra ``sign``; drafts and reviews need the store alone.
"""
