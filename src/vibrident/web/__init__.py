"""The page in the browser: files in, columns confirmed, identified, result out. No arithmetic; all work is called.

``server`` runs it, ``page`` builds one user's page from the steps beside it, ``session`` holds that user's files,
``worker`` identifies in a process of its own.
"""
