"""One file a kind of data: the model that the diagnosis engine asks.

Importing a file registers its model; see :func:`trunnion.diagnosis.register`.
"""
