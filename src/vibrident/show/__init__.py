"""What is shown of results: view models made once (tables, curves, sentences, documents), and one renderer a medium.

``views`` holds the models; ``tables``, ``figures``, ``certificate``, ``comparison`` and ``history`` make them from
results; ``document`` puts them in the order of a report. ``html``, ``markdown``, ``pdf``, ``drawing`` (matplotlib) and
``charts`` (plotly) set them in type; text of others is made harmless there and nowhere else.
"""
