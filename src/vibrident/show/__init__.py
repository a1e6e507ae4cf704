"""Show results: view models made once (tables, curves, documents), and one renderer a medium.

``views`` holds the models; ``tables``, ``findings``, ``figures``, ``certificate``, ``comparison``
and ``history`` make them from results; ``document`` puts them in the order of a report. The
renderers in ``media`` set them in type: ``html``, ``markdown``, ``pdf``, ``console`` (rich),
``drawing`` (matplotlib), ``charts`` (plotly).
"""
