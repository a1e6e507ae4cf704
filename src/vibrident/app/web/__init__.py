"""The page in the browser: upload, confirm columns, identify, show the result. No arithmetic.

``server`` runs it, ``page`` builds one user's page from the steps beside it, ``session`` holds that
user's files, ``worker`` identifies in a process of its own.
"""
